"""Heights from the grey values of a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...arguments import not_found
from ...errors import InputError

Array = np.ndarray

# modes of Pillow for grey values and their white
_WHITE = {"1": 1.0, "L": 255.0, "I;16": 65535.0, "I;16B": 65535.0, "I": 65535.0}


def grey_values(path: Path) -> Array:
    """Return the grey values of a PNG, 0 for black and 1 for white, from its lowest row up, shape (rows, columns).

    Raises
    ------
    InputError
        If there is no such file, or it is no PNG of grey values.
    """
    # it comes with meshcat, and its import is slow
    from PIL import Image

    if not path.is_file():
        raise InputError(not_found(path))
    try:
        with Image.open(path, formats=("PNG",)) as image:
            mode, values = image.mode, np.array(image, dtype=float)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} cannot be read as a PNG: {error}") from error
    if mode not in _WHITE:
        raise InputError(f"{path} has colours ({mode}): save it with grey values, of 8 or 16 bits")
    return values[::-1] / _WHITE[mode]
