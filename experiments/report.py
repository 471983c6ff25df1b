# SPDX-License-Identifier: BSD-3-Clause
"""The report of all experiments with results: report.md, and report.html, which needs no other file."""
import base64
import pathlib
import platform
import re
from typing import Any, Dict, Match, Sequence, Tuple
from xml.etree import ElementTree

import cv2
import markdown
import matplotlib
import numpy

from evaluation import TOP

from .runner import Figure, has_results, read_summary

STYLE = '''
body { max-width: 75em; margin: 2em auto; padding: 0 1em; font: 16px/1.5 sans-serif; color: #222 }
img { max-width: 100% } table { border-collapse: collapse; margin: 1em 0 }
td, th { border: 1px solid #ccc; padding: .2em .6em; text-align: right }
td:first-child, th:first-child { text-align: left }
em { color: #555 } h2 { border-top: 1px solid #ccc; padding-top: 1em }
'''


def write(results: pathlib.Path, names: Sequence[str]) -> Tuple[pathlib.Path, pathlib.Path]:
    """Write both reports of those experiments that have results: the paths of report.md and report.html."""
    summaries = {name: read_summary(results / name) for name in names}
    sections = [_section(name, summary) for name, summary in summaries.items() if summary]
    text = '\n\n'.join([_head(), *sections]) + '\n'
    plain, page = results / 'report.md', results / 'report.html'
    plain.write_text(text)
    page.write_text(html(text, results))
    return plain, page


def html(text: str, folder: pathlib.Path) -> str:
    """A page made of Markdown, with the images embedded.

    :param folder: to which the paths of the images are relative
    """
    body = markdown.markdown(text.replace('\n## ', '\n[TOC]\n\n## ', 1), extensions=['tables', 'toc'])

    def embedded(match: Match[str]) -> str:
        data = base64.b64encode((folder / match.group(1)).read_bytes()).decode()
        return 'src="data:image/png;base64,%s"' % data

    body = re.sub(r'src="([^":]+\.png)"', embedded, body)
    return ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>smokebot_udp: the experiments</title>'
            '<style>%s</style></head>\n<body>\n%s\n</body></html>\n' % (STYLE, body))


def _head() -> str:
    return '\n\n'.join([
        '# smokebot_udp: the experiments',
        'Section 7 of SmokeBot\'s deliverable 6.3 measures how images and point clouds cross a bad Wi-Fi. '
        'These are its experiments, repeated with this package and compared with the usual alternatives.',
        'Versions: %s. The line below each experiment names the code and the machine it was measured with.'
        % versions()])


def versions() -> str:
    """One line: this package, Python and the libraries."""
    return ', '.join([
        'smokebot_udp %s' % ElementTree.parse(str(TOP / 'package.xml')).findtext('version'),
        'Python %s' % platform.python_version(), 'numpy %s' % numpy.__version__, 'OpenCV %s' % cv2.__version__,
        'matplotlib %s' % matplotlib.__version__])


def _section(name: str, summary: Dict[str, Any]) -> str:
    """One experiment as Markdown; summary: see read_summary."""
    lines = ['## ' + summary['title'], summary['explanation']]
    if not has_results(summary):
        return '\n\n'.join([*lines, '**This was %s**' % summary['end']])
    for item in summary['items']:
        if isinstance(item, Figure):
            lines += ['![%s](%s/%s)' % (item.name, name, item.name), '*%s*' % item.caption]
        else:
            lines += [item.caption, item.markdown()]
    return '\n\n'.join([*lines, '*%s, seed %d, %.0f s%s%s; the numbers are in results/experiments/%s*' % (
        summary['date'], summary['seed'], summary['seconds'], ', quick' if summary['quick'] else '',
        _measured_with(summary), name)])


def _measured_with(summary: Dict[str, Any]) -> str:
    """The code and the machine of a run; empty where they were not recorded."""
    if not summary.get('machine'):
        return ''
    code = 'commit %s%s' % (summary['commit'], ' with changes' if summary['dirty'] else '') if summary['commit'] else (
        'no commit known')
    return ', %s, %s, load %g before and %g after' % (code, summary['machine'], *summary['load'])

