"""Proofs of foreign programs, cached between races under a hash of the program's data.

They are in the user's cache, one JSON file per program. A failed proof is cached too, with the reason and the allowed
work; neither depends on the machine.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

from qpsolvers import Problem

from bench.messages import user_cache
from piezo_model import json_file
from piezo_model.atomic_file import write_text
from solvers.certificate import Certificate, NotCertified
from solvers.exact.problem import DoubleProblem

VERSION = 2
"""Cache version; raise it when the format of a proof or what is refused changes."""


@dataclass(frozen=True)
class CachedProof:
    """Content of a file: the proofs in JSON, or the reason for a missing proof."""

    proofs: list[str]
    refusal: str


def key(programs: Sequence[Problem], work: float) -> str:
    """Cache key of the programs' data; NotCertified if they contain NaN or have a wrong shape."""
    try:
        data = [DoubleProblem.of(program).fingerprint for program in programs]
    except ValueError as error:
        raise NotCertified(str(error)) from None
    return hashlib.sha256(json.dumps([VERSION, work, data]).encode()).hexdigest()


def cached(key: str, find: Callable[[], Sequence[Certificate]]) -> list[Certificate]:
    """The cached certificates; without any, those that ``find`` returns, which are then cached.

    Raises
    ------
    NotCertified
        As ``find`` raised it, now or when the result was cached.
    """
    path = user_cache.folder("proofs") / f"{key}.json"
    try:
        cached = json_file.read(path, CachedProof)
        proofs = [Certificate.from_json(text) for text in cached.proofs]
    except ValueError:  # no file, or a damaged one
        try:
            proofs, refusal = list(find()), ""
        except NotCertified as error:
            proofs, refusal = [], str(error)
        cached = CachedProof([proof.to_json() for proof in proofs], refusal)
        user_cache.keep(path, partial(write_text, text=json.dumps(asdict(cached))))
    if cached.refusal:
        raise NotCertified(cached.refusal)
    return proofs
