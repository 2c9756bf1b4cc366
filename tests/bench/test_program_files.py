"""Program files in QPS, MATLAB and NPZ: read exactly, or refused in one sentence."""

import gzip
import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from program_files import DRAWN, dense, same
from programs import library
from qpsolvers import Problem
from recording_files import text_file
from scipy.io import savemat

from bench.problem_files import ProblemFileError, read
from bench.problem_files import qps as qps_files
from bench.problem_files.program import two_sided

SMALL = """NAME          SMALL
ROWS
 N  COST
 G  R1
 L  R2
 E  R3
 E  R4
 N  FREE
COLUMNS
    C1        COST      1.5        R1        2.0
    C1        R2        -1.0       R3        1E-11
    C2        COST      -2.0       R1        1.0
    C2        R2        2.0        R4        1.0
    C3        R3        1.0        FREE      3.0
    C4        R4        1.0D0
RHS
    RHS       COST      -4.0       R1        2.0
    RHS       R2        6.0        R3        1.0
RANGES
    RNG       R1        5.0        R2        1.0
    RNG       R3        -2.0       R4        0.5
BOUNDS
 UP BND       C1        0.75
 FR BND       C3
 UP BND       C2        -3.0
 MI BND       C4
 PL BND       C4
QUADOBJ
    C1        C1        8.0
    C1        C2        2.0
    C2        C2        10.0
    C3        C3        1E-12
ENDATA
"""


def qps(folder: Path, text: str) -> Path:
    return text_file(folder, text, name="small.qps")


def test_rows_ranges_bounds_and_the_quadratic_part_of_a_qps_file_are_read(tmp_path: Path) -> None:
    found, inf = read(qps(tmp_path, SMALL)), np.inf
    rows = np.array([[2, 1, 0, 0], [-1, 2, 0, 0], [1e-11, 0, 1, 0], [0, 1, 0, 1]])
    expected = Problem(
        np.array([[8, 2, 0, 0], [2, 10, 0, 0], [0, 0, 1e-12, 0], [0, 0, 0, 0]]),
        np.array([1.5, -2.0, 0.0, 0.0]),
        np.vstack([rows, -rows]),
        np.array([7, 6, 1, 0.5, -2, -5, 1, 0]),
        lb=np.array([0, -inf, -inf, -inf]),
        ub=np.array([0.75, -3, inf, inf]),
    )
    assert same(found.qp, expected)
    assert (found.constant, sp.issparse(found.qp.P), sp.issparse(found.qp.G)) == (4.0, True, True)


WHOLE_P = SMALL.replace("QUADOBJ", "QMATRIX").replace(
    "    C2        C2        10.0", "    C2        C1        2.0\n    C2        C2        10.0"
)
UNNAMED = re.sub(r"^( [A-Z]{2} |    )(RHS|RNG|BND)      ? ", r"\1", SMALL, flags=re.MULTILINE)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("whole.qps", WHOLE_P),
        *(
            ("named.qps", SMALL.replace("QUADOBJ", each))
            for each in ("QSECTION", "QSECTION      COST", "qsection COST ")
        ),
        ("unnamed.qps", UNNAMED),
        *((name, SMALL) for name in ("small.sif", "small.SIF", "small.qps.gz", "SMALL.MPS.GZ", "small.1.sif.gz")),
    ],
)
def test_a_program_is_the_same_however_it_is_written_and_under_every_suffix(
    tmp_path: Path, name: str, text: str
) -> None:
    path = tmp_path / name
    path.write_bytes(gzip.compress(text.encode()) if name.lower().endswith(".gz") else text.encode())
    assert same(read(path).qp, read(qps(tmp_path, SMALL)).qp)


def test_a_maximum_is_the_negative_of_a_minimum(tmp_path: Path) -> None:
    least, most = (
        read(qps(tmp_path, SMALL.replace("ROWS", f"OBJSENSE\n    {sense}\nROWS", 1))) for sense in ("MIN", "MAX")
    )
    negative = Problem(-most.qp.P, -most.qp.q, most.qp.G, most.qp.h, most.qp.A, most.qp.b, most.qp.lb, most.qp.ub)
    assert (same(least.qp, negative), least.constant) == (True, -most.constant)


def test_a_compressed_program_that_is_damaged_or_endless_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, whole = tmp_path / "small.qps.gz", gzip.compress(SMALL.encode())
    spoilt = bytearray(whole)
    spoilt[len(whole) // 2] ^= 0xFF
    for content, why in (
        *((content, r"[^\n]+$") for content in (b"", SMALL.encode(), whole[:-20], bytes(spoilt))),
        # half a gigabyte in half a megabyte
        (gzip.compress(bytes(2**20)) * 2**9, f"holds more than {qps_files.MOST_BYTES} bytes of text"),
    ):
        path.write_bytes(content)
        with pytest.raises(ProblemFileError, match=rf"small\.qps\.gz: {why}"):
            read(path)
    path.write_bytes(whole)
    monkeypatch.setattr(qps_files, "MOST_BYTES", len(SMALL))
    assert read(path).qp.q.size == 4


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_names_may_contain_blanks_in_fixed_columns(tmp_path: Path, encoding: str) -> None:
    lines = [
        "NAME",
        "ROWS",
        " N  THE COST",
        " L  ROW µµ",
        " L  ROW µ±",
        "COLUMNS",
        "    COL 1     THE COST  -1.0           ROW µµ    2.0",
        "    COL 1     ROW µ±    5.0",
        "RHS",
        "    RHS       ROW µµ    3.0            ROW µ±    6.0",
        "QUADOBJ",
        "    COL 1     COL 1     4.0",
        "ENDATA",
    ]
    path = tmp_path / "named.qps"
    path.write_text("\n".join(lines), encoding)
    found = read(path).qp
    assert [dense(array).ravel().tolist() for array in (found.q, found.G, found.h, found.P)] == [
        [-1.0],
        [2.0, 5.0],
        [3.0, 6.0],
        [4.0],
    ]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("ENDATA", "", "ends without ENDATA"),
        ("0.75", "2o", "line 23: '2o' is not a number"),
        (" UP BND       C1", " BV BND       C1", "line 23: the kind of bound 'BV'"),
        ("R4        1.0D0", "R9        1.0", "line 15: there is no row 'R9'"),
        ("    C3        C3        1E-12", "    C9        C3        1.0", "there is no column 'C9'"),
        ("    C2        C2        10.0", "    C2        C1        10.0", "both sides of the diagonal"),
        (" L  R2", " X  R2", "line 5: the kind of row 'X'"),
        (
            "    C1        R2        -1.0       R3        1E-11",
            "    C1        R1        -1.0",
            "the element R1, C1 is given twice",
        ),
        ("    RHS       R2        6.0", "    OTHER     R2        6.0", "a second vector 'OTHER'"),
        ("RANGES", "CONES", "the section 'CONES' is not one of"),
        ("    C3        R3", "    M  'MARKER'  'INTORG'\n    C3        R3", "integer variables"),
        ("R2        6.0", "R2        nan", "line 18: 'nan' is not a number"),
        ("R2        6.0", "R2        -1E30", "line 18: no number is -1E30 or below, which the row 'R2' asks for"),
        ("COST      -4.0", "COST      inf", "line 17: 'inf' is not a finite number"),
        ("R1        5.0", "R1        NaN", "line 20: 'NaN' is not a number"),
        ("C1        0.75", "C1        nan", "line 23: 'nan' is not a number"),
        ("C1        0.75", "C1        1_0", "line 23: '1_0' is not a number"),
        ("C1        0.75", "C1        -inf", "line 23: no value of the column 'C1' satisfies the bound -inf"),
        (
            " MI BND       C4",
            " UP BND       C2        9.0",
            "line 26: the upper bound of the column 'C2' is given twice, as -3 and as 9",
        ),
        ("    C3        C3        1E-12", "    C3        C3        inf", "'inf' is not a finite number"),
        ("QUADOBJ", "RHS\n    RHS       R4        9.0\nQUADOBJ", "line 28: a second RHS section"),
        ("QUADOBJ", "QSECTION   R1", "line 28: 'R1' follows QSECTION, and only the objective, COST, may be quadratic"),
        ("QUADOBJ", "QSECTION FREE", "line 28: 'FREE' follows QSECTION, and only the objective"),
        ("QUADOBJ", "QSECTION COST R1", "line 28: 'COST R1' follows QSECTION, and only the objective"),
        ("QUADOBJ", "QCMATRIX   R1", "line 28: the section 'QCMATRIX' is not one of"),
        ("QUADOBJ", "QUADOBJ R1", "line 28: 'R1' follows QUADOBJ, which stands alone"),
        ("QUADOBJ", "QMATRIX   COST", "line 28: 'COST' follows QMATRIX, which stands alone"),
        ("ENDATA", "QSECTION R1\n    C1        C1        1.0\nENDATA", "line 33: 'R1' follows QSECTION, and only"),
        ("RHS\n", "RHS   OTHER\n", "line 16: 'OTHER' follows RHS, which stands alone"),
        ("RANGES", "Ranges MINUS", "line 19: 'MINUS' follows Ranges, which stands alone"),
        ("BOUNDS", "BOUNDS BND", "line 22: 'BND' follows BOUNDS, which stands alone"),
        ("COLUMNS", "COLUMNS  X", "line 9: 'X' follows COLUMNS, which stands alone"),
        ("ROWS", "ROWS  9", "line 2: '9' follows ROWS, which stands alone"),
        ("ENDATA", "ENDATA R1", "'R1' follows ENDATA, which stands alone"),
        ("ROWS", "OBJSENSE MAX MIN\nROWS", "line 2: the sense 'MAX MIN' is neither MIN nor MAX"),
        ("ROWS", "OBJSENSE\n    MAX now\nROWS", "line 3: the sense 'MAX now' is neither MIN nor MAX"),
        ("ROWS", "OBJSENSE MIN\n    MAX\nROWS", "line 3: the sense of the objective is given twice"),
        ("R1        5.0", "COST      5.0", "line 20: the row 'COST' is of kind N and has no range"),
        ("R1        5.0", "FREE      5.0", "line 20: the row 'FREE' is of kind N and has no range"),
    ],
)
def test_an_invalid_qps_file_is_refused_with_file_and_line(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in SMALL
    with pytest.raises(ProblemFileError, match=rf"small\.qps: .*{re.escape(sentence)}"):
        read(qps(tmp_path, SMALL.replace(old, new, 1)))


@pytest.mark.parametrize("name", ["drawn.mps", "other.mps"])
def test_highs_reads_the_same_program_from_the_same_file(name: str) -> None:
    engine = library("highspy").Highs()
    engine.silent()
    engine.readModel(str(DRAWN / name))
    lp, hessian = engine.getLp(), engine.getModel().hessian_
    C, L = (
        sp.csc_matrix((each.value_, each.index_, each.start_), shape=(rows, lp.num_col_))
        for each, rows in ((lp.a_matrix_, lp.num_row_), (hessian, lp.num_col_))
    )
    sides = [*map(np.array, (lp.row_lower_, lp.row_upper_, lp.col_lower_, lp.col_upper_))]
    found = read(DRAWN / name)
    assert same(found.qp, two_sided(L + sp.tril(L, -1).T, np.array(lp.col_cost_), C, *sides))
    assert found.constant == lp.offset_
    np.testing.assert_array_equal(dense(found.qp.A), dense(C)[sides[0] == sides[1]])
    np.testing.assert_array_equal([found.qp.lb, found.qp.ub], sides[2:])


def test_a_program_is_the_same_from_mat_and_from_qps() -> None:
    a, b = (read(DRAWN / f"drawn.{suffix}") for suffix in ("mat", "mps"))
    assert same(a.qp, b.qp)
    assert (a.constant, b.constant, sp.issparse(a.qp.P)) == (3.25, 3.25, True)


WHOLE = {"P": np.eye(2), "q": np.ones(2)}
SPARSE = {"data": np.ones(2), "indices": np.array([0, 1]), "indptr": np.array([0, 1, 2]), "shape": np.array([2, 2])}


def compressed(**wrong: list[complex]) -> dict[str, object]:
    """P in compressed columns, with a part that is wrong."""
    return {"P": None, **{f"P/{name}": np.array(value) for name, value in (SPARSE | wrong).items()}}


NUMBERS: list[tuple[dict[str, object], str]] = [
    ({"P": np.eye(2) * 1j}, "P holds complex numbers"),
    ({"q": np.ones(2) + 1j}, "q holds complex numbers"),
    ({"P": np.diag([1.0, np.inf])}, "P has an element that is not a finite number"),
    ({"q": np.array(["1", "2"])}, "q holds no numbers"),
    ({"q": np.array([2**63 - 1, 1])}, "q holds numbers that double precision cannot represent"),
    ({"q": np.ones((2, 2))}, "q must be a vector, not of shape (2, 2)"),
    ({"r": np.nan}, "the constant r must be one finite number"),
    ({"r": [1.0, 2.0]}, "the constant r must be one finite number"),
]
"""Invalid numbers in either format."""


def write(path: Path, content: bytes | dict[str, object] | None) -> None:
    """Write a file of these bytes, or of these arrays beside P and q; none of None."""
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        arrays = {name: value for name, value in (WHOLE | content).items() if value is not None}
        savemat(path, arrays, do_compression=False) if path.suffix == ".mat" else np.savez(path, **arrays)  # type: ignore[arg-type]


OTHER_NAMES = [
    (f"other.{suffix}", key, value)
    for suffix in ("npz", "mat")
    for key, value in {
        "A_ub": np.ones((3, 2)),
        "Aeq": np.ones((1, 2)),
        "x_l": np.zeros(2),
        "C": np.ones((4, 2), dtype=int),
        "Gt": np.ones((2, 5)),
        "G": np.ones((1, 2)),
    }.items()
    if (suffix, key) != ("npz", "G")
]
"""Constraints under names of other packages and formats."""
OF_ONE = {"P": np.eye(1), "q": np.ones(1), "x_l": np.zeros(1)}
"""A bound of a single variable under another name."""


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("shape.mat", {"A": np.eye(3), "l": np.ones(3), "u": np.ones(3)}, "A: expected shape"),
        ("text.mat", b"not a MATLAB file", "cannot be read"),
        ("cut.mat", (DRAWN / "drawn.mat").read_bytes()[:1000], "cannot be read"),
        ("half.npz", {"G": np.eye(2)}, "G without h"),
        ("triangle.npz", {"P": np.triu(np.ones((2, 2)))}, "P is not symmetric"),
        ("nan.npz", {"q": np.array([1.0, np.nan])}, "q has an element that is not a finite number"),
        ("qp.xml", b"", "unknown suffix"),
        ("/dev/null", None, "is not a regular file"),
        ("pickled.npz", {"G": np.array(None), "h": np.ones(1)}, "G is stored as a Python object, which is not read"),
        *((f"wrong{suffix}", *case) for case in NUMBERS for suffix in (".mat", ".npz")),
        ("wrong.mat", {"A": np.eye(2), "l": [0.0, np.nan], "u": np.ones(2)}, "l[1] is nan, which no value satisfies"),
        (
            "wrong.mat",
            {"A": np.eye(2), "l": np.zeros(2), "u": [-1e30, 1.0]},
            "u[0] is -inf, which no value satisfies",
        ),
        ("wrong.npz", {"G": np.eye(2), "h": [np.nan, 1.0]}, "h[0] is nan, which no value satisfies"),
        ("wrong.npz", {"lb": [0.0, np.inf]}, "lb[1] is inf, which no value satisfies"),
        ("wrong.npz", {"ub": [np.nan, 1.0]}, "ub[0] is nan"),
        ("box.mat", {"lb": np.zeros(2)}, "holds lb, which is not read"),
        *((f"one{suffix}", OF_ONE, "holds x_l, which is not read") for suffix in (".npz", ".mat")),
        ("sides.npz", {"u": np.ones(2)}, "holds u, which is not read"),
        *((name, {key: value}, f"holds {key}, which is not read") for name, key, value in OTHER_NAMES),
        *((f"{key}.npz", {key: np.ones(2)}, f"holds {key}, which is not read") for key in ("data", "shape")),
        ("rows.npz", {"G": np.ones((3, 2)), "h": np.ones(3), "h_low": np.ones(3)}, "holds h_low, which is not read"),
        ("columns.npz", {f"Aeq/{name}": value for name, value in SPARSE.items()}, "holds Aeq, which is not read"),
        ("object.npz", {"A_ub": np.array(sp.eye(2), dtype=object)}, "A_ub is stored as a Python object"),
        *((f"none{suffix}", None, "No such file") for suffix in (".npz", ".mat", ".qps")),
        ("no.mat", {"q": None}, "holds no variable 'q'"),
        ("invalid.npz", compressed(indices=[0, 7]), "P has an element outside its 2 rows"),
        ("invalid.npz", compressed(indptr=[0, 3, 2]), "P has columns that do not begin"),
        ("invalid.npz", compressed(shape=[2, 9]), "P is of shape (2, 9) and its index arrays are not"),
        ("invalid.npz", compressed(data=[1.0 + 1j, 1.0]), "P holds complex numbers"),
        ("part.npz", {"P": None, "P/data": np.ones(2)}, "holds no array 'P/indices'"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",  # bytes hold the time at which they were made
)
def test_an_invalid_file_is_refused_with_the_reason(
    tmp_path: Path, name: str, content: bytes | dict[str, object] | None, sentence: str
) -> None:
    write(tmp_path / name, content)
    with pytest.raises(ProblemFileError, match=f"{name}.*{re.escape(sentence)}"):
        read(tmp_path / name)


def test_invalid_index_arrays_of_a_matlab_file_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "invalid.mat", {"P": sp.csc_matrix(np.eye(3)), "q": np.ones(3)})
    whole, rows = (tmp_path / "invalid.mat").read_bytes(), np.arange(3, dtype=np.int32).tobytes()
    assert whole.count(rows) >= 1
    write(tmp_path / "invalid.mat", whole.replace(rows, np.array([0, 1, 10**6], dtype=np.int32).tobytes(), 1))
    with pytest.raises(ProblemFileError, match=r"invalid\.mat: P has an element outside its 3 rows"):
        read(tmp_path / "invalid.mat")


def test_files_that_qpsolvers_saved_are_read(tmp_path: Path) -> None:
    qp = Problem(np.eye(2), np.ones(2), np.ones((1, 2)), np.ones(1), lb=np.zeros(2))
    qp.save(str(tmp_path / "theirs.npz"))
    assert same(read(tmp_path / "theirs.npz").qp, qp)


def test_scalars_and_text_beside_a_program_and_the_files_of_races_are_read(tmp_path: Path) -> None:
    beside = {"obj": 2.5, "n_rows": np.array([7]), "names": np.array(["a", "b"]), "history": np.ones(50), "kind": "QP"}
    for name, row in {
        "beside.npz": {"G": np.ones((1, 2)), "h": np.ones(1)},
        "beside.mat": {"A": np.ones((1, 2)), "l": np.array([-np.inf]), "u": np.ones(1)},
    }.items():
        write(tmp_path / name, beside | row)
        found = read(tmp_path / name).qp
        assert same(found, Problem(WHOLE["P"], WHOLE["q"], np.ones((1, 2)), np.ones(1), lb=found.lb, ub=found.ub))
    assert all(
        read(Path("results/reference") / name).qp.q.size > 2
        for name in ("problems/paper--duhem-staircase.npz", "misses/piqp-direct-measured--afm_head.npz")
    )


def test_arrays_that_are_larger_than_their_file_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path, header = tmp_path / "long.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**9,)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("P.npy", header.getvalue() + bytes(800))
    with pytest.raises(ProblemFileError, match=r"long\.npz: cannot be read as NPZ: P is shorter than its header says"):
        read(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("P.npy", "w", force_zip64=True) as member:
        for _ in range(17):
            member.write(bytes(2**24))
    assert path.stat().st_size < 2**20
    with pytest.raises(ProblemFileError, match=r"holds 285212672 bytes of arrays, and at most 268435456 are read"):
        read(path)


def test_a_matlab_file_that_unpacks_to_more_than_is_read_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mat"
    savemat(path, {"P": np.zeros((6000, 6000)), "q": np.zeros(6000)}, do_compression=True)
    assert path.stat().st_size < 2**20
    with pytest.raises(ProblemFileError, match=r"bomb\.mat: its values take [0-9,]+ bytes; at most"):
        read(path)
