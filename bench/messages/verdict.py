"""What a race says of an answer: the accuracy that it must reach, and how its task ended."""

from enum import StrEnum


class Tier(StrEnum):
    """The accuracy that an answer must reach, the same for all solvers."""

    DEFAULT = "default"
    """The library's own settings."""
    LOW = "low"
    """Relative cost gap 1e-3."""
    MID = "mid"
    """Relative cost gap 1e-6."""
    HIGH = "high"
    """Relative cost gap 1e-9."""
    EXACT = "exact"
    """Relative cost gap 1e-12."""
    STAGE = "stage"
    """The stage does not notice: on unseen data the error of the model exceeds that of the exact optimum by at most 1 %
    of the sensor noise."""


class Status(StrEnum):
    """How a task ended. A faulty adapter is never reported as a failing solver."""

    OK = "ok"
    """The answer has the required accuracy."""
    MISSED = "missed"
    """The solver reports success, but the answer misses the required accuracy."""
    SOLVER_FAILED = "solver_failed"
    """The solver itself reports that it found no answer."""
    ADAPTER_FAILED = "adapter_failed"
    """The adapter or the library's interface raised an exception."""
    UNSUPPORTED = "unsupported"
    """The solver cannot take a problem of this form."""
    CRASHED = "crashed"
    """The process died."""
    TIMED_OUT = "timed_out"
    """The process was stopped at its time limit."""
    OUT_OF_MEMORY = "out_of_memory"
    """The process was stopped at its memory limit."""
    TAMPERED = "tampered"
    """Its process opened files of the race or of other processes, or sent what nobody had asked for."""
    NOT_RUN = "not_run"
    """A looser setting of the same solver crashed, was stopped or took too long on this problem."""
    LATE = "late"
    """The answer is right, but came after its deadline."""
