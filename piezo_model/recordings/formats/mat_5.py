"""MATLAB files of versions 5 to 7, which SciPy reads when their size is known.

A variable may be compressed a thousandfold, and an array in a cell or a field may state any shape. So compressed
variables are first unpacked in chunks and discarded to find their size, and SciPy's reader is then checked at each
header."""

import math
import struct
import zlib
from pathlib import Path
from typing import Any

from scipy.io.matlab._mio5 import MatFile5Reader
from scipy.io.matlab._mio5_utils import VarReader5

from piezo_model.recordings.table import check_size

COMPRESSED, SPARSE = 15, 5
"""Type of a compressed variable, and class of a matrix that is stored without its zeros."""
CHUNK, ARRAY_BYTES = 1 << 10, 200
"""Bytes that are unpacked at once, and memory of an array without values."""


def read_mat_5(path: Path, most: int | None = None, *, simplify: bool = True) -> dict[str, Any]:
    """Every variable, with ``simplify`` structs as dictionaries and numbers without axes; RecordingError for more bytes
    than ``most``, or else than a recording may have."""
    with path.open("rb") as file:
        reader = _Reader(file, simplify_cells=simplify)
        reader.most = most
        unpacked = file.seek(128)
        while len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(f"{reader.byte_order}II", tag)
            end, unpack = file.tell() + length, zlib.decompressobj()
            while kind == COMPRESSED and (chunk := file.read(min(CHUNK, end - file.tell()))):
                unpacked += len(unpack.decompress(chunk))
                check_size(path, unpacked, most)
            file.seek(end)
        return reader.get_variables()


class _Reader(MatFile5Reader):
    def initialize_read(self) -> None:
        """Set the reader of variables."""
        super().initialize_read()
        self._matrix_reader = _Arrays(self)
        self._matrix_reader.path, self._matrix_reader.most = self.mat_stream.name, self.most


class _Arrays(VarReader5):
    size = 0

    def read_header(self, *arguments: Any) -> Any:
        """The header of a variable, or of an array in it, before its values are read."""
        header = super().read_header(*arguments)
        if header.mclass != SPARSE:
            self.size += ARRAY_BYTES + 8 * math.prod(map(abs, header.dims or ()))
        check_size(self.path, self.size, self.most)
        return header
