"""Converts the meshes of a scene to plain values and back; of a height field the heights only."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from ...geometry.meshes.height_field import height_field
from ...geometry.meshes.triangles import Surface
from ..items import SurfaceItem


def mesh_data(item: SurfaceItem) -> dict[str, Any]:
    """Return the fields "surface" and "heights" of a mesh as plain values."""
    if item.heights is not None:
        # a million heights take 10 MB as text; the mesh in figures would take ten times as much
        packed = base64.b64encode(zlib.compress(item.heights.astype("<f8").tobytes(), 1)).decode()
        return {"surface": None, "heights": {"shape": list(item.heights.shape), "packed": packed}}
    mesh = item.surface
    sheet = {"vertices": mesh.vertices.tolist(), "triangles": mesh.triangles.tolist(), "one_sided": mesh.one_sided}
    return {"surface": sheet, "heights": None}


def mesh_back(data: dict[str, Any]) -> dict[str, Any]:
    """Return the fields "surface", "heights" and "size" that `mesh_data` wrote."""
    stored: Any = data["surface"]
    if stored is not None:
        # older files know sheets only
        side = stored.get("one_sided", False)
        mesh = Surface(np.array(stored["vertices"]), np.array(stored["triangles"]), side)
        return {"surface": mesh, "heights": None, "size": None}
    packed: Any = data["heights"]
    try:
        values = np.frombuffer(zlib.decompress(base64.b64decode(packed["packed"])), "<f8")
    except zlib.error as error:
        raise ValueError(f"the heights of {data['name']} are damaged: {error}") from error
    heights, (along_x, along_y) = values.reshape(packed["shape"]), data["size"]
    return {"surface": height_field(heights, (along_x, along_y)), "heights": heights, "size": (along_x, along_y)}
