from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(
    packages=['smokebot_udp'] + ['smokebot_udp.' + room for room in (
        'codecs', 'link_lab', 'nodes', 'simulation', 'streams', 'supervisor', 'udpros')],
    package_dir={'': 'src'}))
