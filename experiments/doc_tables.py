# SPDX-License-Identifier: BSD-3-Clause
"""Writes the tables of doc/ from the results: ./smokebot experiments --doc.

A page has blocks

    <!-- table: EXPERIMENT/NAME -->
    (what the function NAME of the module's DOC_TABLES makes of the results)
    <!-- end -->

and one `<!-- table: conditions -->`, which says with what code, when and where its tables were measured. The first line
of a block that was written also names the commit and the date. A block without results keeps what it has.
"""
import pathlib
import re
import textwrap
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from evaluation import TOP

from .catalogue import EXPERIMENTS, load
from .runner import Table, has_results, read_summary

PAGES = TOP / 'doc' / 'experiments.md', TOP / 'doc' / 'fill.md'
CONDITIONS = 'conditions'
BLOCK = re.compile(r'<!-- table: ([\w/]+)(?: \(([^)]*)\))? -->\n(.*?)<!-- end -->\n', re.DOTALL)
"""Name, provenance or None, content."""

UNKNOWN = 'not recorded'
COLUMNS = 6
"""Number of columns of the conditions."""

WIDTH = 120
"""Maximum length of a line of a caption [characters]."""

Summary = Mapping[str, Any]
"""See runner.read_summary."""


class Refused(Exception):
    """These results are not of one state of the code; the message says why."""


class Source(NamedTuple):
    """What the tables of a page come from: a row of the conditions."""
    commit: str
    seed: Any
    machine: str


def write(results: pathlib.Path, mixed: bool = False, pages: Sequence[pathlib.Path] = PAGES) -> List[str]:
    """Renew the blocks of the pages; the warnings.

    :param mixed: even if the results are of several commits, or of code with changes that are not committed
    :raises Refused: where they are, and `mixed` is false
    """
    texts = {page: page.read_text() for page in pages}
    names = [name for text in texts.values() for name in experiments_of(text)]
    found, warnings = usable(results, names)
    if not mixed:
        check_one_commit(found)
    for page, text in texts.items():
        page.write_text(renewed(text, results, found))
    return warnings


def experiments_of(text: str) -> List[str]:
    """The names of the experiments whose tables a page contains."""
    return list(dict.fromkeys(name.split('/')[0] for name, *_ in BLOCK.findall(text) if name != CONDITIONS))


def usable(results: pathlib.Path, names: Sequence[str]) -> Tuple[Dict[str, Summary], List[str]]:
    """{experiment: summary} of those with whole results, and a warning for each of the others."""
    found: Dict[str, Summary] = {}
    warnings = []
    for name in names:
        summary = read_summary(results / name)
        if summary is not None and has_results(summary) and not summary['quick']:
            found[name] = summary
            continue
        why = ('not measured' if summary is None else 'of a quick run' if has_results(summary) else summary['end'])
        warnings.append('%s keeps its tables: %s' % (name, why))
    return found, warnings


def check_one_commit(found: Mapping[str, Summary]) -> None:
    """:raises Refused: where results are not of one commit, or of code that was changed since"""
    commits: Dict[str, List[str]] = {}
    for name, summary in found.items():
        commits.setdefault(commit_of(summary), []).append(name)
    if len(commits) > 1:
        raise Refused('results of several states of the code: ' + '; '.join(
            '%s: %s' % (commit, ', '.join(names)) for commit, names in commits.items()))
    for name, summary in found.items():
        if summary.get('dirty') or not summary.get('commit'):
            raise Refused('%s is of the code %s' % (name, commit_of(summary)))


def commit_of(summary: Summary) -> str:
    """The commit of the code that was measured, for a reader. It says whether the code had further changes."""
    commit = summary.get('commit')
    if not commit:
        return UNKNOWN
    return '%s with changes' % commit if summary.get('dirty') else str(commit)


def renewed(text: str, results: pathlib.Path, found: Mapping[str, Summary]) -> str:
    """A page with the blocks of these experiments made anew, and its conditions."""
    def block(match: 're.Match[str]') -> str:
        experiment, _, name = match.group(1).partition('/')
        if experiment not in found:
            return match.group(0)
        table: Table = load(experiment).DOC_TABLES[name](results / experiment)
        summary = found[experiment]
        return written(match.group(1), in_markdown(table), '%s, %s' % (commit_of(summary), summary['date'][:10]))

    text = BLOCK.sub(block, text)
    conditions = in_markdown(conditions_of(text, found))
    return BLOCK.sub(lambda match: written(CONDITIONS, conditions) if match.group(1) == CONDITIONS else match.group(0),
                     text)


def written(name: str, content: str, provenance: Optional[str] = None) -> str:
    """A block."""
    return '<!-- table: %s%s -->\n%s\n<!-- end -->\n' % (name, ' (%s)' % provenance if provenance else '', content)


def in_markdown(table: Table) -> str:
    """A table of a page, its caption above it."""
    caption = textwrap.fill(table.caption, WIDTH, break_long_words=False, break_on_hyphens=False)
    return '\n\n'.join(filter(None, [caption, table.markdown()]))


def conditions_of(text: str, found: Mapping[str, Summary]) -> Table:
    """With what code, when and where the tables of a page were measured."""
    sources: Dict[Source, List[str]] = {}
    for name in experiments_of(text):
        if name in found:
            summary = found[name]
            source = Source(commit_of(summary), summary['seed'], summary.get('machine') or UNKNOWN)
            sources.setdefault(source, []).append(name)
    rows: List[Sequence[Any]] = [
        [', '.join(names), source.commit, span(found[name]['date'] for name in names), source.seed, source.machine,
         highest_load([found[name] for name in names])] for source, names in sources.items()]
    kept: Dict[Sequence[Any], List[str]] = {}
    former = former_conditions(text)
    for name, provenance, _ in BLOCK.findall(text):
        experiment = name.split('/')[0]
        if name == CONDITIONS or experiment in found:
            continue
        commit, _, date = (provenance or UNKNOWN).partition(', ')
        before = former.get(experiment)
        row = before if before and before[0] == commit else (commit, date, None, None, None)
        if experiment not in kept.setdefault(row, []):
            kept[row].append(experiment)
    rows += [[', '.join(names), *row] for row, names in kept.items()]
    return Table('', ['tables of', 'commit', 'measured', 'seed', 'machine', 'load before, at most'], rows)


def former_conditions(text: str) -> Dict[str, Tuple[str, ...]]:
    """{experiment: commit, time, seed, machine and load} as a page has them until now."""
    tables = [content for name, _, content in BLOCK.findall(text) if name == CONDITIONS]
    rows = [[cell.strip() for cell in line.split('|')[1:-1]] for table in tables for line in table.splitlines()]
    return {name: tuple(row[1:]) for row in rows if len(row) == COLUMNS for name in row[0].split(', ')}


def span(dates: Iterator[str]) -> str:
    """The period from the first to the last date, as text."""
    ordered = sorted(dates)
    return ordered[0] if ordered[0] == ordered[-1] else '%s to %s' % (ordered[0], ordered[-1])


def highest_load(summaries: Sequence[Summary]) -> Optional[float]:
    """The highest load of the machine when an experiment began; None: not recorded."""
    loads = [summary['load'][0] for summary in summaries if summary.get('load')]
    return max(loads) if loads else None


def generators() -> List[str]:
    """The names of all blocks that can be made."""
    return ['%s/%s' % (name, each) for name in EXPERIMENTS for each in getattr(load(name), 'DOC_TABLES', {})]
