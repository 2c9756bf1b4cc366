"""Types of arrays; their shapes are said where they are used."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Index = NDArray[np.int64]
Nanoseconds = NDArray[np.int64]
Mask = NDArray[np.bool_]
