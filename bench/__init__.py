"""Races, judges, stores and reports: the benchmark and its command line.

A measured row, from the call of a solver to the page:

    races/worker.py          TimedSolver.block   in the solver's process: update and solve, timed by `timing/clock.py`
    races/measuring.py       timed               unseen data block by block, beside a clock of its own
    races/measuring.py       row_of              the times, and the errors by `races/metrics.py`
    race_table.py            complete            the columns
    part_file.py             save                appended to the stream of its part, before the next task starts
    races/passes.py          second_pass         what is measured again
    store.py                 finish              one table of all parts; `messages/columns.py` checks what is read
    derived/measurements.py  at_tiers            right or not, and the setting of each tier, by `derived/tiers.py`
    derived/summary.py       summary             a line for each solver lane, tier and set
    derived/ranking.py       ranking             the first table
    derived/schedule.py      on_schedule         late answers
    derived/verdict.py       verdict             sentences
    derived/pictures.py      work_precision      the first picture, declared in `races/figures.py`
    races/report.py          report              one `report/report.py` `Report`, rendered as page, Markdown and screen

A problem, from its set to the report:

    problems/simulation.py   problem             one file a set; data of a plant become program (6)
    problems/protocol.py     certified           proven in exact arithmetic
    races/run_problems.py    problems_of         saved in the run (`store.py`), without its certificate
    races/race.py            tasks_of            tasks, by solver and setting
    races/passes.py          do                  one problem in one scaling, by one worker
    problems/fresh.py        FreshData           the data of its timed calls
    races/measuring.py       timed               sends them
    races/metrics.py         judge               judges the answers (`problems/gap_bounds.py`)
    races/report.py          optima              how far off a wrong tolerance would be

An option of a race: a field of `races/settings.py`, and the file that uses it.
"""
