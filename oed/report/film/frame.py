"""What a film is made of."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Frame = npt.NDArray[np.uint8]
"""An RGB image, (height, width, 3)."""
