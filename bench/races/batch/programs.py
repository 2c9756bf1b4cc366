"""The programs of a batch race: mixtures of neighbouring windows of recordings, no two alike.

Every simulated actuator under every drive, identified with a model of d = 18 (n = 5, m = 3) or d = 60 (n = 20, m = 9),
gives a family of four windows. A program is drawn from one family,

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,   θ uniform over θ ≥ 0, Σ θ_k = 1,   lb ≤ x,

and the family is drawn for each program. Active sets, condition numbers (1e4 to 1e11) and bounds differ from program to
program. The programs are in files outside the run's folder, which children map. Only the parent knows which answers are
judged; their optima are proven after the solvers have answered.
"""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from bench.messages.progress import Progress
from bench.messages.race_error import RaceError
from bench.problems.fresh import FreshData
from bench.problems.paper import DRIVES
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.problems.simulation import Experiment
from bench.races.batch.worker import Files
from bench.store import Run
from piezo_model import plants

ORDERS = {18: (5, 3), 60: (20, 9)}
"""Orders n and m of the model by d."""
SET = "batch"
CHUNK = 512
"""Number of programs that are mixed at once, which bounds the memory."""
SHARED_MEMORY = Path("/dev/shm")


@contextmanager
def reserved(sizes: Sequence[int], count: int) -> Iterator[Path]:
    """A folder with the files of ``count`` programs of each size, in shared memory or else in the folder of temporary
    files; RaceError if neither has the space.

    The files get their full size now, since a write to mapped memory without space behind it ends the process.
    """
    temporary = Path(tempfile.gettempdir())
    for parent in (SHARED_MEMORY, temporary):
        with ExitStack() as stack:
            try:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="piezobench-batch-", dir=parent)))
                for d in sizes:
                    Files(folder, d, count).reserve()
            except OSError:
                continue
            yield folder
            return
    megabytes = sum(8 * count * d * (d + 3) for d in sizes) / 1e6
    raise RaceError(
        f"the programs need {megabytes:.0f} MB in {SHARED_MEMORY} or in {temporary}, and neither has the space; "
        "enlarge one of them, or make the batches smaller with --largest"
    )


class Programs:
    """All ``count`` programs of one size, and the proofs of those whose answers are judged.

    The run stores the families, at most ``limit`` of them, so that a resumed race has the same programs; ``folder``
    comes from :func:`reserved`.
    """

    def __init__(
        self, run: Run, d: int, count: int, seed: int, folder: Path, limit: int | None, progress: Progress
    ) -> None:
        self.files = Files(folder, d, count)
        forms = [problem.forms["scaled"] for problem in _families(run, d, seed, limit, progress)]
        self._family = np.random.default_rng([seed, d]).integers(len(forms), size=count)
        self._mixtures = [FreshData(form, int(np.sum(self._family == f)), [seed, d, f]) for f, form in enumerate(forms)]
        self._rank = np.random.default_rng().permutation(count)  # not reproducible on purpose
        progress(f"{count} programs of {d} variables", 0, 1)
        P, q, lb, ub = self.files.mapped(0, count, "r+")
        for f, (form, mixture) in enumerate(zip(forms, self._mixtures, strict=True)):
            members = np.flatnonzero(self._family == f)
            lb[members], ub[members] = form.qp.lb, form.qp.ub
            for first in range(0, members.size, CHUNK):
                chunk = members[first : first + CHUNK]
                P[chunk], q[chunk] = mixture.block(first, first + chunk.size)

    def sample(self, first: int, last: int, most: int) -> list[int]:
        """At most ``most`` of the programs ``first`` to ``last`` − 1; overlapping ranges share them, so that few proofs
        are needed."""
        return sorted(first + int(i) for i in np.argsort(self._rank[first:last])[:most])

    def proven(self, b: int) -> CertifiedForm | None:
        """Program b with its certified optimum; None if it cannot be proven."""
        f = self._family[b]
        return self._mixtures[f].certified(int(np.sum(self._family[:b] == f)))


def _families(run: Run, d: int, seed: int, limit: int | None, progress: Progress) -> list[RaceProblem]:
    """A problem with its windows for each actuator and drive, stored in the run."""
    cases = [(plant, drive) for plant in plants.names() for drive in DRIVES][:limit]
    problems = []
    for i, (plant, drive) in enumerate(cases):
        progress(f"{plant} under a {drive}, d = {d}", i, len(cases))
        name = f"{plant}-{drive}-{d}"
        path = run.problem_path(SET, name)
        if not path.is_file():
            Experiment(plant, drive, *ORDERS[d], seed=seed + i).problem(SET, name).save(path)
        problems.append(run.problem(SET, name))
    return problems
