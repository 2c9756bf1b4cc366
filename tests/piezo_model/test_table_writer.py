import resource
import stat
import tempfile
from pathlib import Path

import numpy as np
import pytest
from recording_files import HEADER, signals, without_privileges

from piezo_model.recordings import Recording, RecordingError, write_table


@pytest.fixture(params=[".csv", ".parquet"])
def old(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / f"stage{request.param}"
    write_table(path, signals())
    return path


def test_a_written_table_comes_back_to_the_last_bit(old: Path) -> None:
    columns = {
        "time_s": np.arange(500) * 125e-6,
        "u_V": np.random.default_rng(2).normal(size=500),
        "y_um": np.arange(500),
    }
    write_table(old, columns)
    recording = Recording.open(old)
    x, y = recording.x, recording.y
    np.testing.assert_array_equal(x, columns["u_V"])
    np.testing.assert_array_equal(y, columns["y_um"])


@pytest.mark.parametrize(
    ("name", "columns", "sentence"),
    [
        ("drive.xlsx", {"t": [0, 1]}, r"unknown suffix '.xlsx'; a table is written as .csv or .parquet"),
        ("drive", {"t": [0, 1]}, "unknown suffix ''"),
        ("drive.csv", {}, "needs at least one column"),
        ("drive.csv", {"t": [0, 1], "u": [1]}, r"of one length, not 't' \(2,\), 'u' \(1,\)"),
        ("drive.csv", {"t": [[0, 1]]}, "one-dimensional"),
        ("drive.csv", {"t": [0, 1], "u": [1, np.nan]}, "column 'u' holds nan in data row 2"),
        ("drive.csv", {"t": ["a", "b"]}, "column 't' holds <U1, where numbers are needed"),
        ("absent/drive.csv", {"t": [0, 1]}, "cannot be written: No such file"),
    ],
)
def test_a_table_that_cannot_be_written_is_refused_and_leaves_nothing(
    tmp_path: Path, name: str, columns: dict, sentence: str
) -> None:
    with pytest.raises(RecordingError, match=sentence):
        write_table(tmp_path / name, columns)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_halfway_leaves_the_old_file_untouched(old: Path) -> None:
    before, (soft, hard) = old.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    columns = {name: np.random.default_rng(3).normal(size=100_000) for name in HEADER.split(",")}
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))  # like a full disk
    try:
        with pytest.raises(RecordingError, match=r"stage.*cannot be written: File too large"):
            write_table(old, columns)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert old.read_bytes() == before
    assert list(old.parent.iterdir()) == [old]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_read_only_folder_is_refused_and_its_files_stay(suffix: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"drive{suffix}"
        write_table(path, {"t": [0, 1]})
        before = path.read_bytes()
        path.chmod(0o444)
        Path(name).chmod(0o555)
        with (
            without_privileges(),
            pytest.raises(RecordingError, match=r"drive.*cannot be written: Permission denied"),
        ):
            write_table(path, {"t": [0, 1, 2]})
        Path(name).chmod(0o755)
        assert path.read_bytes() == before
        assert list(Path(name).iterdir()) == [path]


def test_a_written_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "ordinary").touch()
    write_table(tmp_path / "drive.csv", {"t": [0, 1]})
    ordinary, written = (stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("ordinary", "drive.csv"))
    assert written == ordinary


def test_writing_through_a_link_replaces_its_target(tmp_path: Path) -> None:
    (tmp_path / "real.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to(tmp_path / "real.csv")
    write_table(tmp_path / "link.csv", {"t": [0, 1]})
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real.csv").read_text() == "t\n0\n1\n"
