"""Triangle meshes: their normals, and PLY files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from plyfile import PlyData, PlyElement


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in world units; faces are counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]

    @property
    def face_vectors(self) -> Float[np.ndarray, "faces 3"]:
        """Outward normals of the faces, as long as twice their area."""
        first, second, third = (self.vertices[self.faces[:, corner]] for corner in range(3))
        vectors: Float[np.ndarray, "faces 3"] = np.cross(second - first, third - first)
        return vectors

    @property
    def normals(self) -> Float[np.ndarray, "vertices 3"]:
        """Unit outward normals: means of the adjoining faces' by area; zero for a vertex without a face."""
        total = np.zeros_like(self.vertices)
        vectors = self.face_vectors
        for corner in range(3):
            np.add.at(total, self.faces[:, corner], vectors)
        length = np.linalg.norm(total, axis=-1, keepdims=True)
        unit: Float[np.ndarray, "vertices 3"] = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
        return unit

    @property
    def area(self) -> float:
        """Square world units."""
        return float(np.linalg.norm(self.face_vectors, axis=-1).sum() / 2)


def write_mesh(mesh: Mesh, path: Path) -> None:
    """Write binary little-endian PLY: x y z and nx ny nz as float32, faces as vertex_indices.

    A link in its place is replaced. Raises OSError.
    """
    columns = ("x", "y", "z", "nx", "ny", "nz")
    rows = np.empty(len(mesh.vertices), dtype=[(name, "<f4") for name in columns])
    for name, values in zip(columns, np.hstack([mesh.vertices, mesh.normals]).T, strict=True):
        rows[name] = values
    faces = np.empty(len(mesh.faces), dtype=[("vertex_indices", "<i4", (3,))])
    faces["vertex_indices"] = mesh.faces
    described = [PlyElement.describe(rows, "vertex"), PlyElement.describe(faces, "face")]
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink():
        path.unlink()
    PlyData(described, byte_order="<").write(str(path))
