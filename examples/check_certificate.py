"""Check the certificate of a quadratic program with Python alone: nothing here comes from the program that wrote it.

python check_certificate.py certificate.json [problem.npz]

Every number of the certificate is checked in rational arithmetic; docs/certificates.md says what each means.
"""

import ast
import json
import struct
import sys
import zipfile
from fractions import Fraction
from math import inf, isinf, prod
from typing import Any

PRIME = 2**61 - 1
Row = list[Fraction]
Data = dict[str, Any]


def check(holds: bool, why: str) -> None:
    """End with exit status 1 and a reason unless something holds."""
    if not holds:
        sys.exit(f"refused: {why}")


def doubles(value: Any) -> Any:
    """Doubles in hexadecimal as rationals; an infinite bound stays an infinity."""
    if isinstance(value, list):
        return [doubles(each) for each in value]
    number = float.fromhex(value)
    return number if isinf(number) else Fraction(number)


def dot(a: Row, b: Row) -> Fraction:
    """Inner product of two vectors."""
    return sum((x * y for x, y in zip(a, b, strict=True) if x and y), Fraction(0))


def is_semidefinite(P: list[Row]) -> bool:
    """Symmetric elimination without fractions (E. H. Bareiss, Math. Comp. 22, 1968)."""
    scale = max(entry.denominator for row in P for entry in row)
    S, last = [[int(entry * scale) for entry in row] for row in P], 1
    for k, row in enumerate(S):
        if row[k] < 0 or (row[k] == 0 and any(row[k:])):
            return False
        if row[k]:
            for i in range(k + 1, len(S)):
                for j in range(i, len(S)):
                    S[i][j] = S[j][i] = (row[k] * S[i][j] - row[i] * row[j]) // last
            last = row[k]
    return True


def has_rank(rows: list[Row], rank: int) -> bool:
    """Whether rows of doubles have this rank modulo a prime, and so over the rationals at least."""
    left = [[entry.numerator * pow(entry.denominator, -1, PRIME) % PRIME for entry in row] for row in rows]
    for column in range(rank):
        pivot = next((row for row in left if row[column]), None)
        if pivot is None:
            return False
        left.remove(pivot)
        inverse = pow(pivot[column], -1, PRIME)
        for i, row in enumerate(left):
            factor = row[column] * inverse
            left[i] = [(a - factor * b) % PRIME for a, b in zip(row, pivot, strict=True)]
    return True


def slacks_at(x: Row, data: Data) -> dict[str, Row]:
    """What is left of each constraint by field; an equality has to leave zero."""
    return {
        "G": [h - dot(row, x) for row, h in zip(data["G"], data["h"], strict=True)],
        "A": [b - dot(row, x) for row, b in zip(data["A"], data["b"], strict=True)],
        "lb": [entry - low for entry, low in zip(x, data["lb"], strict=True)],
        "ub": [high - entry for entry, high in zip(x, data["ub"], strict=True)],
    }


def is_feasible(slacks: dict[str, Row]) -> bool:
    """Whether no constraint is broken."""
    return all(s >= 0 for field in ("G", "lb", "ub") for s in slacks[field]) and not any(slacks["A"])


def check_optimum(what: str, stated: dict[str, Row], P: list[Row], q: Row, data: Data) -> dict[str, Row]:
    """The KKT conditions of a convex program prove that x is an optimum of it."""
    x, multipliers = stated["x"], {field: stated[field] for field in ("G", "A", "lb", "ub")}
    slacks = slacks_at(x, data)
    check(is_feasible(slacks), f"{what} breaks a constraint")
    for field in ("G", "lb", "ub"):
        for multiplier, slack in zip(multipliers[field], slacks[field], strict=True):
            check(multiplier >= 0, f"{what} has a negative multiplier of {field}")
            check(multiplier == 0 or slack == 0, f"{what} has a multiplier of {field} that is not tight")
    for i in range(len(x)):
        gradient = dot(P[i], x) + q[i] - multipliers["lb"][i] + multipliers["ub"][i]
        gradient += sum(dot([row[i] for row in data[field]], multipliers[field]) for field in ("G", "A"))
        check(gradient == 0, f"{what} is not stationary")
    return slacks


def array(archive: zipfile.ZipFile, name: str) -> tuple[list[Any], list[int]]:
    """An array of an NPZ file as a flat list in the order of rows, and its shape; empty for a stored Python object."""
    content = archive.read(name + ".npy")
    start = 10 if content[6] == 1 else 12
    header = ast.literal_eval(content[start : start + int.from_bytes(content[8:start], "little")].decode())
    shape = list(header["shape"])
    if header["descr"] == "|O":  # a None
        return [], [0]
    form = f"<{prod(shape)}" + {"<f8": "d", "<i4": "i", "<i8": "q"}[header["descr"]]
    flat = list(struct.unpack(form, content[len(content) - struct.calcsize(form) :]))
    if header["fortran_order"] and len(shape) == 2:
        flat = [flat[j * shape[0] + i] for i in range(shape[0]) for j in range(shape[1])]
    return flat, shape


def field_of(archive: zipfile.ZipFile, name: str, missing: Any) -> Any:
    """A field of a program file as nested lists, also of a matrix in compressed columns; ``missing`` if it has none."""
    for stored in (name, "raw/" + name):  # the second in a problem that a race has stored
        if stored + "/data.npy" in archive.namelist():
            data, indices, starts, (rows, columns) = (
                array(archive, f"{stored}/{part}")[0] for part in ("data", "indices", "indptr", "shape")
            )
            matrix = [[0.0] * columns for _ in range(rows)]
            for j in range(columns):
                for k in range(starts[j], starts[j + 1]):
                    matrix[indices[k]][j] = data[k]
            return matrix
        if stored + ".npy" in archive.namelist():
            flat, shape = array(archive, stored)
            if len(shape) == 2:
                return [flat[i * shape[1] : (i + 1) * shape[1]] for i in range(shape[0])]
            return [x if abs(x) < 1e20 or name == "q" else inf if x > 0 else -inf for x in flat] or missing
    return missing


def main(certificate: str, problem: str | None = None) -> None:
    """Check every number, and that the data are those of a file if it is given."""
    with open(certificate, encoding="utf-8") as file:
        document = json.load(file)
    check(document["format"] == "certificate of a quadratic program, version 1", "this is another format")
    data = {name: doubles(value) for name, value in document["problem"].items()}
    q, d, shift, constant = data["q"], len(data["q"]), doubles(document["shift"]), doubles(document["constant"])
    if problem is not None:
        with zipfile.ZipFile(problem) as archive:
            for name, value in data.items():
                missing = [-inf] * d if name == "lb" else [inf] * d if name == "ub" else []
                check(field_of(archive, name, missing) == value, f"{name} of the certificate is not that of {problem}")
            constants = field_of(archive, "c", None) or field_of(archive, "r", None) or [0.0]
            check(constant == constants[0], f"the constant is not that of {problem}")
    check(all(data["P"][i][j] == data["P"][j][i] for i in range(d) for j in range(i)), "P is not symmetric")
    identity = [[Fraction(i == j) for j in range(d)] for i in range(d)]
    P = [[entry + (shift if i == j else 0) for j, entry in enumerate(row)] for i, row in enumerate(data["P"])]
    check(0 <= shift * d * 10**12 <= sum(data["P"][i][i] for i in range(d)), "δ is more than rounding makes of P")
    check(is_semidefinite(P), "P + δI is not positive semidefinite")

    def cost(x: Row) -> Fraction:
        return sum(x[i] * (dot(P[i], x) / 2 + q[i]) for i in range(d)) + constant

    def rationals(stated: Data) -> dict[str, Row]:
        return {name: list(map(Fraction, stated[name])) for name in ("x", "G", "A", "lb", "ub")}

    best = rationals(document["optimum"])
    slacks, x, value = check_optimum("x*", best, P, q, data), best["x"], Fraction(document["optimum"]["value"])
    check(cost(x) == value, "x* has another cost")
    linear, of_shift = dot(q, x), shift * dot(x, x) / 2
    check(of_shift * 10**12 <= abs(value - constant - linear - of_shift) + abs(linear), "δ decides the optimum")
    tight = {field: [i for i, slack in enumerate(slacks[field]) if slack == 0] for field in slacks}
    check(document["active"] == tight, "other constraints are active")
    check([repr(float(entry)) for entry in x] == document["rounded"]["x"], "x is not x* rounded")
    check(repr(float(value)) == document["rounded"]["value"], "the rounded value is another")
    if document["unique"] == "yes":
        rows = [row for row, multiplier in zip(data["G"], best["G"], strict=True) if multiplier > 0]
        rows += [identity[i] for i in range(d) if best["lb"][i] > 0 or best["ub"][i] > 0]
        check(has_rank([*P, *data["A"], *rows], d), "no rank proves that x* is the only optimum")
    elif document["unique"] == "no":
        other = list(map(Fraction, document["second_optimum"]))
        check(is_feasible(slacks_at(other, data)), "the second optimum breaks a constraint")
        check(other != x and cost(other) == value, "the second optimum is none")
    else:
        check(document["unique"] == "undecided", "whether x* is unique is stated in another word")
    if "answer" in document:
        stated, answer = document["answer"], doubles(document["answer"]["x"])
        nearest = rationals(stated["nearest"])
        check_optimum("the nearest feasible point", nearest, identity, [-entry for entry in answer], data)
        violation, distance = (max(abs(a - b) for a, b in zip(answer, y, strict=True)) for y in (nearest["x"], x))
        check(Fraction(stated["gap"]) == cost(nearest["x"]) - value, "the gap of the answer is another")
        check(Fraction(stated["violation"]) == violation, "the violation of the answer is another")
        check(Fraction(stated["distance"]) == distance, "the distance of the answer is another")
    print(f"every number holds: the least cost is {float(value)!r}, and x* is unique: {document['unique']}")


if __name__ == "__main__":
    main(*sys.argv[1:])
