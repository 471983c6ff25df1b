# SPDX-License-Identifier: BSD-3-Clause
"""The report of a mission, made of the bags that the black boxes of both sides have recorded.

`bags` reads the bags; `record` collects what the report needs of their messages, times and not images, so the memory is
bounded. `mission`, `gaps` and `summary` calculate with it, by the robot's clock. `film_strip` chooses images, which are
read in a second pass; `plots` draws, and `page` writes the HTML. `cli` is
the command.
"""
