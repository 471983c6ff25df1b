# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS beside TCPROS, roscpp and the bare sockets: CPU, rate without loss, latency of 1.4 kB messages."""
import json
import os
import pathlib
import select
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import xmlrpc.client

HERE = pathlib.Path(__file__).resolve().parent
RESULTS = HERE.parent / 'results' / 'bench'

MODES = {'rospy TCPROS': 'tcp', 'roscpp UDPROS': 'roscpp', 'ours, by the message': 'message',
         'ours, by the frame': 'frame', 'bare sockets (GSO, recvmmsg)': 'bare'}
RATE, SECONDS, ROUNDS = 5000, 3, 3
"""CPU is measured at this rate [messages/s] for so long, and the median of the rounds is taken."""

FRAME_RATE = 27000
"""By the frame: Table 1 of the deliverable, raw [messages/s]."""

CLIMB = (5000, 10000, 15000, 20000, 27000, 40000, 60000, 80000)
"""Rates that are tried for one without loss [messages/s]."""


class Peer:
    """One end, in a process of its own."""

    def __init__(self, command):
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         stderr=subprocess.DEVNULL, universal_newlines=True, bufsize=1)

    def line(self, patience=60.0):
        if not select.select([self._process.stdout], [], [], patience)[0]:
            self.close()
            raise RuntimeError('%s says nothing for %g s' % (self._process.args, patience))
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError('%s ended with %s' % (self._process.args[:3], self._process.wait()))
        return line.strip()

    def ask(self, words):
        self._process.stdin.write(words + '\n')
        self._process.stdin.flush()
        return self.line()

    def close(self):
        self._process.stdin.close()
        self._process.terminate()
        self._process.wait()


class Master:
    """A roscore for the benchmark alone."""

    def __enter__(self):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            port = probe.getsockname()[1]
        os.environ.update(ROS_MASTER_URI='http://127.0.0.1:%d' % port, ROS_IP='127.0.0.1')
        self._logs = tempfile.mkdtemp()
        os.environ['ROS_LOG_DIR'] = self._logs
        self._process = subprocess.Popen(['rosmaster', '--core', '-p', str(port)], stdout=subprocess.DEVNULL,
                                         stderr=subprocess.DEVNULL)
        while True:
            try:
                xmlrpc.client.ServerProxy(os.environ['ROS_MASTER_URI']).getUri('/bench')
                return self
            except OSError:
                time.sleep(0.05)

    def __exit__(self, *_):
        self._process.terminate()
        self._process.wait()
        shutil.rmtree(self._logs, ignore_errors=True)


def build_roscpp_peer(folder):
    """Compile roscpp_peer.cpp with catkin's flags; None where roscpp cannot be built against."""
    flags = subprocess.run(['pkg-config', '--cflags', '--libs', 'roscpp'], stdout=subprocess.PIPE,
                           stderr=subprocess.DEVNULL, text=True)
    if flags.returncode:
        return None
    target = str(folder / 'roscpp_peer')
    include = [path + '/include' for path in os.environ.get('CMAKE_PREFIX_PATH', '').split(':')]
    done = subprocess.run(['g++', '-O2', '-o', target, str(HERE / 'roscpp_peer.cpp')]
                          + ['-I' + path for path in include] + flags.stdout.split() + ['-lpthread'],
                          stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return target


def pair(mode, roscpp):
    """(receiver, sender), connected."""
    # a name's length matters to roscpp: 3 in 54 do not connect (ros_comm#2160)
    topic = '/bench/segments/' + mode
    script = [sys.executable, str(HERE / 'udpros_peer.py')]
    commands = {role: [roscpp, role, topic] if mode == 'roscpp' else script + [role, mode, topic]
                for role in ('receive', 'send')}
    receiver = Peer(commands['receive'])
    if mode == 'bare':
        commands['send'][-1] = receiver.line()
    sender = Peer(commands['send'])
    for peer in (receiver, sender):
        assert peer.line() == 'ready'
    return receiver, sender


def one_round(receiver, sender, rate, seconds):
    receiver.ask('begin')
    sent = json.loads(sender.ask('send %g %g' % (rate, seconds)))
    received = json.loads(receiver.ask('report'))
    return {'sent': sent['sent'], 'received': received['received'], 'p50': received['p50'], 'p99': received['p99'],
            'sender_us': 1e6 * sent['cpu'] / sent['sent'],
            'receiver_us': 1e6 * received['cpu'] / max(1, received['received']),
            'sender_cores': sent['cpu'] / seconds, 'receiver_cores': received['cpu'] / seconds}


def run(log):
    """{way: numbers}"""
    results = {}
    with tempfile.TemporaryDirectory() as folder, Master():
        roscpp = build_roscpp_peer(pathlib.Path(folder))
        for name, mode in MODES.items():
            if mode == 'roscpp' and roscpp is None:
                log('roscpp is left out: pkg-config does not find it (install libroscpp-dev)')
                continue
            log('measuring ' + name)
            results[name] = measure(mode, roscpp)
    plot(results)
    return results


def measure(mode, roscpp):
    receiver, sender = pair(mode, roscpp)
    try:
        rate = FRAME_RATE if mode in ('frame', 'bare') else RATE
        one_round(receiver, sender, rate, 0.5)     # caches, branch predictors, the processor's clock
        rounds = [one_round(receiver, sender, rate, SECONDS) for _ in range(ROUNDS)]
        result = {key: statistics.median(r[key] for r in rounds) for key in rounds[0]}
        result['lost'] = sum(r['sent'] - r['received'] for r in rounds)
        result['rate'] = rate
        result['lossless'] = 0
        for rate in CLIMB:
            attempt = one_round(receiver, sender, rate, 1.0)
            if attempt['received'] < attempt['sent']:
                break
            result['lossless'] = rate
        return result
    finally:
        sender.close()
        receiver.close()


def table(results, machine):
    lines = ['1.4 kB messages over loopback, %s' % machine,
             '%-30s %8s %12s %14s %10s %10s %6s %14s' % ('', 'at [1/s]', 'sender [us]', 'receiver [us]', 'p50 [ms]',
                                                        'p99 [ms]', 'lost', 'lossless [1/s]')]
    for name, r in results.items():
        lines.append('%-30s %8d %12.2f %14.2f %10.2f %10.2f %6d %14d' % (
            name, r['rate'], r['sender_us'], r['receiver_us'], 1e3 * r['p50'], 1e3 * r['p99'], r['lost'],
            r['lossless']))
    if 'roscpp UDPROS' in results:
        base = results['roscpp UDPROS']
        for name in ('ours, by the message', 'ours, by the frame'):
            lines.append('%s: %.2f of roscpp\'s CPU sending, %.2f receiving' % (
                name, results[name]['sender_us'] / base['sender_us'],
                results[name]['receiver_us'] / base['receiver_us']))
    frame = results['ours, by the frame']
    lines.append('Table 1 raw, by the frame: %d messages/s on %.2f cores sending, %.2f receiving, %d of %d lost' % (
        FRAME_RATE, frame['sender_cores'], frame['receiver_cores'], frame['lost'], ROUNDS * frame['sent']))
    lines.append('plot: %s' % (RESULTS / 'udpros.png').relative_to(HERE.parent))
    return '\n'.join(lines)


def plot(results):
    """Bars of both sides' CPU, written to results/bench/udpros.png."""
    import matplotlib
    matplotlib.use('Agg')
    from matplotlib import pyplot
    RESULTS.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(figsize=(9, 3.2))
    names = list(results)[::-1]
    for offset, side in ((0.2, 'sender'), (-0.2, 'receiver')):
        values = [results[name][side + '_us'] for name in names]
        bars = axes.barh([i + offset for i in range(len(names))], values, 0.38, label=side)
        axes.bar_label(bars, ['%.1f' % value for value in values], padding=3)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel('CPU for each 1.4 kB message [us]')
    axes.legend()
    figure.tight_layout()
    figure.savefig(str(RESULTS / 'udpros.png'), dpi=110)
