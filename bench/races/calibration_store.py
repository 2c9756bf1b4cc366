"""What calibrations found, and the problems that they were made on, kept between races.

Both are in the user's cache, under a hash of all that they follow from:
this package's version, the set with its options and seed, and for a finding the scaling, the solver's version and its ladder.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.passed import user_cache
from bench.passed.progress import Progress
from bench.problem_files.program import ProblemFileError
from bench.problems import make
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem, Window
from bench.races.settings import RaceSettings
from piezo_model import json_file
from piezo_model.atomic_file import write_text
from piezo_model.identification_problem import Scaling
from solvers import Tier
from solvers.registry import Described

SEEDS = (1000, 2000, 3000)
"""Added to the seed of the race; a set may use some seeds from its own on."""
MIXTURES = 3
"""Data of each calibration problem that a solver is given as it is in a race: after a set-up with others."""
RULE = 6
"""Counts how often what is asked of a setting has changed."""

Findings = Mapping[Tier, tuple[int | None, bool]]


def key(settings: RaceSettings, of_set: str, scaling: Scaling, solver: Described) -> str:
    """What a finding follows from, as a file name; "" for a solver without a version, which may change at any time."""
    return _hashed(*_problems(settings, of_set), scaling, solver.name, solver.lane, solver.version, solver.ladder) if solver.version else ""


def load(key: str) -> Findings:
    """What was found; nothing where there is nothing that can be read."""
    path = user_cache.folder("settings") / f"{key}.json"
    try:
        return json_file.read(path, dict[Tier, tuple[int | None, bool]]) if key else {}
    except ValueError:  # not there, or damaged: it is found again
        return {}


def save(key: str, findings: Findings) -> None:
    """Keep what was found."""
    if key:
        user_cache.keep(user_cache.folder("settings") / f"{key}.json", partial(write_text, text=json.dumps(findings)))


def problems(of_set: str, settings: RaceSettings, progress: Progress) -> list[RaceProblem]:
    """The calibration problems of a set, made once: those of the race, each under one of the other seeds.

    Data are mixed as for timing; the first of a form's windows is what a solver is set up with.
    """
    kept = user_cache.folder("problems") / _hashed(*_problems(settings, of_set))
    whole = len(make(of_set, settings.seed, settings.set_options))
    count = min(whole, settings.limit or whole)
    paths = [[kept / f"{i:03d}-{mixture}.npz" for mixture in range(MIXTURES)] for i in range(count)]
    try:
        return [RaceProblem.load(path) for several in paths for path in several]
    except ProblemFileError:
        found: dict[Path, RaceProblem] = {}
        for first, shift in enumerate(SEEDS):
            made = make(of_set, settings.seed + shift, settings.set_options).problems()
            for i, (several, problem) in enumerate(zip(paths, made, strict=False)):
                if i % len(SEEDS) == first:
                    progress(f"calibration problem {problem.name}", i, count)
                    fresh = {scaling: FreshData(form, MIXTURES, seed=i) for scaling, form in problem.forms.items()}
                    for mixture, path in enumerate(several):
                        found[path] = replace(problem, forms={scaling: _mixed(form, fresh[scaling], mixture)
                                                              for scaling, form in problem.forms.items()})
                        user_cache.keep(path, found[path].save)
        return [found[path] for several in paths for path in several]


def _mixed(form: CertifiedForm, fresh: FreshData, mixture: int) -> CertifiedForm:
    """What a form is updated with; itself where that cannot be proven."""
    P = form.qp.P if isinstance(form.qp.P, np.ndarray) else form.qp.P.toarray()
    return replace(fresh.certified(mixture) or form, windows=(Window(P, form.qp.q, form.c),))


def _problems(settings: RaceSettings, of_set: str) -> tuple[Any, ...]:
    options = make(of_set, settings.seed, settings.set_options).options
    return importlib.metadata.version("piezobench"), RULE, of_set, settings.seed, settings.limit, options


def _hashed(*parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:24]
