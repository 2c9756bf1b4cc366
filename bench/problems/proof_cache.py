"""Proofs of programs that come from anywhere, kept between races under a hash of the data that they are proofs of.

They lie in the user's cache, one JSON file a program. What could not be proven is kept too, with the reason and the
work that was allowed, since neither depends on the machine.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial

from qpsolvers import Problem

from bench.messages import user_cache
from piezo_model import json_file
from piezo_model.atomic_file import write_text
from solvers.certificate import Certificate, NotCertified
from solvers.exact.problem import DoubleProblem

VERSION = 1
"""Of what a proof is: another number forgets those that were found."""


@dataclass(frozen=True)
class CachedProof:
    """What is in a file: the proofs in JSON, or why there is none."""

    proofs: list[str]
    refusal: str


def key(programs: Sequence[Problem], work: float) -> str:
    """Name of the programs' data; NotCertified where they hold no numbers."""
    try:
        data = [DoubleProblem.of(program).fingerprint for program in programs]
    except ValueError as error:
        raise NotCertified(str(error)) from None
    return hashlib.sha256(json.dumps([VERSION, work, data]).encode()).hexdigest()


def load(key: str) -> list[Certificate] | None:
    """The certificates that are kept; None where there are none.

    Raises
    ------
    NotCertified
        For the reason that is kept.
    """
    try:
        found = json_file.read(user_cache.folder("proofs") / f"{key}.json", CachedProof)
        proofs = [Certificate.from_json(text) for text in found.proofs]
    except ValueError:  # not there, or damaged: it is found again
        return None
    if found.refusal:
        raise NotCertified(found.refusal)
    return proofs


def save(key: str, proofs: Sequence[Certificate], refusal: str = "") -> None:
    """Keep what was found."""
    found = json.dumps(asdict(CachedProof([proof.to_json() for proof in proofs], refusal)))
    user_cache.keep(user_cache.folder("proofs") / f"{key}.json", partial(write_text, text=found))
