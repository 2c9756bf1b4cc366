"""MATLAB files of versions 5 to 7, which SciPy reads when their size is known.

A variable may be compressed a thousandfold, and an array in a cell or a field may state any shape. So SciPy's reader is
checked at each tag of a compressed variable, which states its size, and at each header of an array."""

import math
from pathlib import Path
from typing import Any

from scipy.io.matlab._mio5 import MatFile5Reader
from scipy.io.matlab._mio5_utils import VarReader5

from piezo_model.recordings.table import check_size

SPARSE = 5
"""Class of a matrix that is stored without its zeros."""
ARRAY_BYTES = 200
"""Memory of an array without values."""


def read_mat_5(path: Path, most: int | None = None, *, simplify: bool = True) -> dict[str, Any]:
    """Every variable, with ``simplify`` structs as dictionaries and numbers without axes; RecordingError for more bytes
    than ``most``, or else than a recording may have."""
    with path.open("rb") as file:
        reader = _Reader(file, simplify_cells=simplify)
        reader.most = most
        return reader.get_variables()


class _Reader(MatFile5Reader):
    def initialize_read(self) -> None:
        """Set the reader of variables."""
        super().initialize_read()
        self._matrix_reader = _Arrays(self)
        self._matrix_reader.path, self._matrix_reader.most = self.mat_stream.name, self.most


class _Arrays(VarReader5):
    size = 0

    def read_full_tag(self) -> Any:
        """Kind and bytes of a compressed variable, before it is unpacked."""
        kind, size = super().read_full_tag()
        check_size(self.path, size, self.most)
        return kind, size

    def read_header(self, *arguments: Any) -> Any:
        """The header of a variable, or of an array in it, before its values are read."""
        header = super().read_header(*arguments)
        if header.mclass != SPARSE:
            self.size += ARRAY_BYTES + 8 * math.prod(map(abs, header.dims or ()))
        check_size(self.path, self.size, self.most)
        return header
