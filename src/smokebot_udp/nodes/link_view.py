# SPDX-License-Identifier: BSD-3-Clause
"""The live view of link_top: its table on a terminal's whole screen, with colours, sparklines and scrolling."""
import contextlib
import curses
import locale
import os
import textwrap
import time
from typing import Any, Callable, Dict, List

from ..monitoring.plots import ASCII_BARS, BARS, Plots

REFRESH_PERIOD = 0.25
"""How often the screen is drawn [s]."""

ROOM = (175, 20), (145, 10), (130, 5)
"""(columns of a terminal, bars of each sparkline that fit then)"""

INDENT = 7 * ' '
"""Indentation of the further lines of a text that does not fit in one line of the terminal."""

COLOURS = {'OK': curses.COLOR_GREEN, 'WARN': curses.COLOR_YELLOW, 'ERROR': curses.COLOR_RED,
           'STALE': curses.COLOR_MAGENTA}
UNCOLOURED = {'WARN': curses.A_BOLD, 'ERROR': curses.A_REVERSE, 'STALE': curses.A_REVERSE}


def show(screen: Any, table: Callable[[Plots], List[str]], plain: bool) -> None:
    """Draw until q is pressed.

    :param screen: a curses window
    :param table: f(plots) -> lines, as of link_table.render
    :param plain: whether there are no sparklines
    """
    styles, scrolled = _prepare(screen), 0
    plots = Plots(BARS if 'utf' in locale.nl_langinfo(locale.CODESET).lower() else ASCII_BARS)
    while True:
        rows, columns = screen.getmaxyx()
        plots.begin(0 if plain else next((bars for width, bars in ROOM if columns > width), 0), time.monotonic())
        lines = [part for line in table(plots) for part in textwrap.wrap(
            line, max(columns - 1, 2 * len(INDENT)), subsequent_indent=INDENT, break_on_hyphens=False) or ['']]
        scrolled = max(0, min(scrolled, len(lines) - rows))
        screen.erase()
        for row, line in enumerate(lines[scrolled:scrolled + rows]):
            # the last column stays free: writing the screen's last cell is an error in curses
            with contextlib.suppress(curses.error):
                level = line.partition(' ')[0]
                screen.addnstr(row, 0, line, columns - 1)
                screen.chgat(row, 0, len(level), styles.get(level, 0))
        screen.refresh()
        key = screen.getch()
        if key == ord('q'):
            return
        scrolled += {curses.KEY_DOWN: 1, curses.KEY_UP: -1, curses.KEY_NPAGE: rows, curses.KEY_PPAGE: -rows}.get(key, 0)


def _prepare(screen: Any) -> Dict[str, int]:
    """Set the terminal up; returns {level: attribute}."""
    screen.timeout(int(1e3 * REFRESH_PERIOD))
    with contextlib.suppress(curses.error):     # not supported by every terminal
        curses.curs_set(0)
    if 'NO_COLOR' in os.environ:
        return UNCOLOURED
    with contextlib.suppress(curses.error):
        curses.use_default_colors()
        for pair, colour in enumerate(COLOURS.values(), 1):
            curses.init_pair(pair, colour, -1)
        return {level: curses.color_pair(pair) | curses.A_BOLD for pair, level in enumerate(COLOURS, 1)}
    return UNCOLOURED
