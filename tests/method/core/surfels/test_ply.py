"""Surfels come back from a PLY file bit for bit, under the names that 3DGS gave them."""

from pathlib import Path

import torch
from plyfile import PlyData

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.ply import write_ply
from radiogs_core.surfels.surfels import Surfels
from surfel_files import read_ply


def some_surfels() -> Surfels:
    generator = torch.Generator().manual_seed(3)
    shapes = {
        "centre": (7, 3), "rotation": (7, 4), "log_scale": (7, 2), "opacity_logit": (7,), "sh": (7, 16, 3),
        "albedo_logit": (7, 3), "roughness_logit": (7,),
    }  # fmt: skip
    return Surfels.of({name: torch.randn(shape, generator=generator) for name, shape in shapes.items()})


def test_every_parameter_comes_back_bit_for_bit(tmp_path: Path) -> None:
    surfels = some_surfels()
    write_ply(surfels, tmp_path / "s.ply")
    found = read_ply(tmp_path / "s.ply").parameters()
    for name, value in surfels.parameters().items():
        assert torch.equal(found[name], value), name


def decoded(path: Path) -> dict[str, torch.Tensor]:
    """The values that a viewer of 3DGS reads from a file: attributes by their documented names, decoded.

    Names, order, logit, natural logarithm and (w, x, y, z): graphdeco-inria/gaussian-splatting, scene/gaussian_model.py
    (``construct_list_of_attributes``, ``save_ply``); PlayCanvas' user manual, "The PLY Format" and ``DataTable`` of
    splat-transform; ossia's GaussianSplatData.
    """
    rows = PlyData.read(str(path))["vertex"].data
    column = {name: torch.from_numpy(rows[name].astype("f8")) for name in rows.dtype.names}
    dc = torch.stack([column[f"f_dc_{channel}"] for channel in range(3)], -1)
    rest = torch.stack([column[f"f_rest_{place}"] for place in range(45)], -1).view(-1, 3, 15)
    return {
        "centre": torch.stack([column[name] for name in "xyz"], -1),
        "opacity": 1 / (1 + (-column["opacity"]).exp()),
        "scale": torch.stack([column[f"scale_{axis}"] for axis in range(3)], -1).exp(),
        "wxyz": torch.nn.functional.normalize(torch.stack([column[f"rot_{place}"] for place in range(4)], -1), dim=-1),
        "sh": torch.cat([dc[:, None], rest.transpose(1, 2)], 1),
        "normal": torch.stack([column[name] for name in ("nx", "ny", "nz")], -1),
    }


def test_the_attributes_are_those_of_3dgs_in_its_order_and_then_our_own(tmp_path: Path) -> None:
    write_ply(some_surfels(), tmp_path / "s.ply")
    element = PlyData.read(str(tmp_path / "s.ply"))["vertex"]
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{place}" for place in range(45)]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert [each.name for each in element.properties][:62] == names
    assert {each.val_dtype for each in element.properties} == {"f4"}
    own = [each.name for each in element.properties][62:]
    assert own == [
        *(f"radiance_{place}" for place in range(48)),
        *(f"albedo_logit_{channel}" for channel in range(3)), "roughness_logit",
    ]  # fmt: skip
    header = (tmp_path / "s.ply").read_bytes()[:100]
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\n")


def test_a_viewer_sees_the_surfels_where_they_are_flat_and_as_opaque_as_they_are(tmp_path: Path) -> None:
    surfels = some_surfels()
    write_ply(surfels, tmp_path / "s.ply")
    seen = decoded(tmp_path / "s.ply")
    assert torch.equal(seen["centre"], surfels.centre.double())
    torch.testing.assert_close(seen["opacity"], surfels.opacity.double())
    torch.testing.assert_close(seen["scale"][:, :2], surfels.scale.double())
    torch.testing.assert_close(seen["scale"][:, 2], 1e-3 * surfels.scale.double().amin(-1))
    w, x, y, z = seen["wxyz"].unbind(-1)
    rotation = torch.stack([
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ], -1).view(-1, 3, 3)  # fmt: skip
    torch.testing.assert_close(rotation, surfels.frame.double(), atol=1e-6, rtol=0)
    torch.testing.assert_close(seen["normal"], rotation[..., 2], atol=1e-6, rtol=0)


def test_a_viewer_shows_radiance_as_display_srgb(tmp_path: Path) -> None:
    """colour = 1/2 + 0.2820947917738781 f_dc where nothing depends on the view; 0.2140 of light are shown as 0.5."""
    surfels = some_surfels()
    surfels.sh.zero_()
    surfels.sh[:, 0] = (torch.tensor([0.21404, 1.0, 0.0031308]) - 0.5) / 0.2820947917738781
    write_ply(surfels, tmp_path / "s.ply")
    sh = decoded(tmp_path / "s.ply")["sh"]
    colour = 0.5 + 0.2820947917738781 * sh[:, 0]
    torch.testing.assert_close(colour, torch.tensor([0.5, 1.0, 0.04045]).double().expand_as(colour), atol=1e-4, rtol=0)
    assert float(sh[:, 1:].abs().max()) < 1e-5


def test_colours_change_with_the_view_as_they_do_on_a_display(tmp_path: Path) -> None:
    surfels = some_surfels()
    fall = 0.5 ** torch.tensor([0, *[1] * 3, *[2] * 5, *[3] * 7])
    surfels.sh.mul_(0.2 * fall[:, None])
    write_ply(surfels, tmp_path / "s.ply")
    outgoing = torch.nn.functional.normalize(torch.randn(7, 200, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    truth = srgb_encode(surfel_radiance(surfels.sh, outgoing).clamp(max=1)).double()
    shown = surfel_radiance(decoded(tmp_path / "s.ply")["sh"].float(), outgoing).double()
    linear = surfel_radiance(surfels.sh, outgoing).double()
    assert float((shown - truth).abs().max()) < 0.01
    assert float((linear - truth).abs().mean()) > 0.1, "linear radiance would be shown dark"
