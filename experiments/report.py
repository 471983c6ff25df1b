# SPDX-License-Identifier: BSD-3-Clause
"""The report of all experiments that were run: report.md, and report.html, which needs no other file."""
import base64
import platform
import re
import subprocess
from xml.etree import ElementTree

import cv2
import markdown
import matplotlib
import numpy

from benchmarks.machine import describe

from .runner import DONE, TOP, Figure, told_of

STYLE = '''
body { max-width: 75em; margin: 2em auto; padding: 0 1em; font: 16px/1.5 sans-serif; color: #222 }
img { max-width: 100% } table { border-collapse: collapse; margin: 1em 0 }
td, th { border: 1px solid #ccc; padding: .2em .6em; text-align: right }
td:first-child, th:first-child { text-align: left }
em { color: #555 } h2 { border-top: 1px solid #ccc; padding-top: 1em }
'''


def write(results, names):
    """Write both reports of the experiments of these names that were run: the paths of report.md and report.html."""
    told = {name: told_of(results / name) for name in names}
    text = '\n\n'.join([_head(), *(_section(name, told[name]) for name in names if told[name])]) + '\n'
    plain, page = results / 'report.md', results / 'report.html'
    plain.write_text(text)
    page.write_text(html(text, results))
    return plain, page


def html(text, folder):
    """A page of Markdown text, with the pictures it names, relative to a folder, in the page itself."""
    body = markdown.markdown(text.replace('\n## ', '\n[TOC]\n\n## ', 1), extensions=['tables', 'toc'])

    def embedded(match):
        data = base64.b64encode((folder / match.group(1)).read_bytes()).decode()
        return 'src="data:image/png;base64,%s"' % data

    body = re.sub(r'src="([^":]+\.png)"', embedded, body)
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>smokebot_udp: the experiments</title>'
            '<style>%s</style></head>\n<body>\n%s\n</body></html>\n' % (STYLE, body))


def _head():
    return '\n\n'.join([
        '# smokebot_udp: the experiments',
        'SmokeBot\'s deliverable 6.3 measured, in its section 7, how pictures and point clouds cross a bad Wi-Fi. '
        'These are its experiments, done again with this package, beside what one would use instead.',
        'Machine: %s. Versions: %s.' % (describe(), versions())])


def versions():
    """One line."""
    version = ElementTree.parse(str(TOP / 'package.xml')).findtext('version')
    commit = subprocess.run(['git', '-C', str(TOP), 'describe', '--always', '--dirty'], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL).stdout.decode().strip()
    return ', '.join(filter(None, [
        'smokebot_udp %s' % version, commit and 'commit %s' % commit, 'Python %s' % platform.python_version(),
        'numpy %s' % numpy.__version__, 'OpenCV %s' % cv2.__version__, 'matplotlib %s' % matplotlib.__version__]))


def _section(name, told):
    """:param told: as told_of returns it"""
    lines = ['## ' + told['title'], told['explanation']]
    if told['end'] != DONE:
        return '\n\n'.join(lines + ['**This was %s**' % told['end']])
    for item in told['items']:
        if isinstance(item, Figure):
            lines += ['![%s](%s/%s)' % (item.name, name, item.name), '*%s*' % item.caption]
        else:
            lines += [item.caption, _table(item)]
    return '\n\n'.join(lines + ['*%s, seed %d, %.0f s%s; the numbers lie in results/experiments/%s*' % (
        told['date'], told['seed'], told['seconds'], ', quick' if told['quick'] else '', name)])


def _table(table):
    rows = [table.head, ['---'] * len(table.head), *table.rows]
    return '\n'.join('| %s |' % ' | '.join(map(_cell, row)) for row in rows)


def _cell(value):
    return '' if value is None else '%.4g' % value if isinstance(value, float) else str(value)
