"""Traps of the public codes' layouts: names that collide, lights that were left out, files that only look right."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from public_outputs import WRITERS, noisy, png, write_svg_ir
from radiogs_baselines.outputs.reading import likely_codes, read_predictions
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.metrics.psnr import psnr
from radiogs_bench.scoring.score_files import score_predictions
from radiogs_bench.scoring.score_maps import coverage, truth
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import read_image


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("corner")


@pytest.fixture(scope="module")
def synthetic4relight(scene: Scene) -> Scene:
    """The same scene with the names that Synthetic4Relight gives to views and lights."""
    lights = dict(zip(scene.lights, ("envmap12", "envmap6"), strict=True))

    def renamed(place: int, view: View) -> View:
        sources = {}
        for name, read in view.sources.items():
            kind, _, rest = name.partition("/")
            light = rest.removesuffix("/indirect")
            sources[name if kind != "relit" else name.replace(light, lights[light])] = read
        return View(f"test/{place:03d}", view.camera, sources)

    test = tuple(renamed(place, view) for place, view in enumerate(scene.test))
    return replace(scene, test=test, lights={lights[name]: light for name, light in scene.lights.items()})


def values(folder: Path, scene: Scene, code: str | None = None, under: str = "default") -> dict[str, float | None]:
    (score,) = score_predictions(read_predictions(folder, scene, code), scene, [protocol(under)])
    return {name: metric["value"] for name, metric in score.metrics.items()}


@pytest.mark.parametrize("code", ["r3dg", "svg-ir"])
def test_views_are_found_by_the_stem_of_their_image(code: str, synthetic4relight: Scene, tmp_path: Path) -> None:
    WRITERS[code](tmp_path, noisy(synthetic4relight))
    predictions = read_predictions(tmp_path, synthetic4relight)
    assert predictions.files["image"]["test/003"] == "eval/render/003_rgba.png"
    assert not predictions.missing


@pytest.mark.parametrize(
    ("code", "kind"), [("radiogs", "render"), ("irgs", "render"), ("r3dg", "pbr"), ("svg-ir", "pbr")]
)
def test_lights_of_synthetic4relight_go_by_their_short_names(
    code: str, kind: str, synthetic4relight: Scene, tmp_path: Path
) -> None:
    predicted = noisy(synthetic4relight)
    bare = {name: {k: v for k, v in maps.items() if "/" not in k} for name, maps in predicted.items()}
    WRITERS[code](tmp_path, bare)
    for index, maps in enumerate(predicted.values()):
        png(tmp_path / f"test_rli/env6/{kind}/{index}.png", maps["relit/envmap6"])
        png(tmp_path / f"test_rli/env12/{kind}/{index}.png", maps["relit/envmap12"])
    assert likely_codes(tmp_path) == [code]
    predictions = read_predictions(tmp_path, synthetic4relight)
    assert predictions.files["relit/envmap6"]["test/000"] == f"test_rli/env6/{kind}/0.png"
    assert set(predictions.relit) == {"envmap6", "envmap12"}


def test_views_that_overwrote_each_other_are_not_scored(scene: Scene, tmp_path: Path) -> None:
    WRITERS["r3dg"](tmp_path, noisy(scene))
    predictions = read_predictions(tmp_path, scene)
    assert predictions.absent == ("image (eval/render/test_000.png)",)
    assert predictions.files["albedo"]["test_002"] == "test/ours_50000/base_color/00002.png"
    assert any(line.startswith("eval/render/rgba.png: it names files by") for line in predictions.ignored)
    assert any(line.startswith("test/ours_50000/renders/*.png (8 files): the SH image") for line in predictions.ignored)


def test_pictures_at_a_quarter_of_the_size_are_left_out_and_the_rest_is_scored(scene: Scene, tmp_path: Path) -> None:
    write_svg_ir(tmp_path, noisy(scene), step=4)
    predictions = read_predictions(tmp_path, scene)
    assert set(predictions.files) == {f"relit/{light}" for light in scene.lights}
    assert any("image (test/ours_50000/renders" in line and "24 x 24 pixels" in line for line in predictions.ignored)
    assert values(tmp_path, scene)["relight/psnr"] is not None


def test_a_mask_beside_the_colours_does_not_multiply_them_and_an_own_coverage_does(
    scene: Scene, tmp_path: Path
) -> None:
    view = scene.test[0]
    half = torch.full((view.camera.height, view.camera.width, 4), 0.6)
    png(tmp_path / "svg/test/ours_1/renders/00000.png", half)
    png(tmp_path / f"plain/image/{view.name}.png", half)
    for code, folder, expected in (("svg-ir", "svg", 0.6), ("plain", "plain", 0.36)):
        image = read_predictions(tmp_path / folder, scene, code).read(view, coverage(view))["image"]
        torch.testing.assert_close(image, torch.full_like(image, expected))


def test_scaled_albedo_does_not_make_a_gs_ir_folder_one_of_gi_gs(scene: Scene, tmp_path: Path) -> None:
    predicted = noisy(scene)
    WRITERS["gs-ir"](tmp_path, predicted)
    for index, maps in enumerate(predicted.values()):
        png(tmp_path / f"test/ours_None/pbr/{index:05d}_albedo.png", 0.5 * maps["albedo"])
    assert likely_codes(tmp_path) == ["gs-ir"]
    predictions = read_predictions(tmp_path, scene)
    assert predictions.files["albedo"]["test_000"].endswith("00000_brdf.png")
    assert "test/ours_None/pbr/*_albedo.png (8 files): albedo that --brdf_eval has scaled to the truth" in (
        predictions.ignored
    )


@pytest.mark.parametrize("code", ["radiogs", "irgs", "gs-ir", "gi-gs", "tensoir"])
def test_a_folder_that_counts_more_views_is_of_another_scene(code: str, scene: Scene, tmp_path: Path) -> None:
    WRITERS[code](tmp_path, noisy(scene))
    with pytest.raises(DataError, match=r"counts views up to 7, scene 'corner' has 7 test views"):
        read_predictions(tmp_path, replace(scene, test=scene.test[:7]), code)


def test_a_missing_light_leaves_no_mean_over_all_lights(scene: Scene, tmp_path: Path) -> None:
    WRITERS["irgs"](tmp_path, noisy(scene))
    (tmp_path / "test_rli_light/envmap_sunset").rename(tmp_path / "elsewhere")
    predictions = read_predictions(tmp_path, scene)
    assert predictions.absent == (
        "relit under sunset (test_rli_light/envmap_sunset/render/0.png, test_rli/sunset/render/0.png)",
    )
    default, orb = score_predictions(predictions, scene, [protocol("default"), protocol("stanford-orb")])
    for score, measure in ((default, "psnr"), (orb, "psnr_h")):
        assert score.metrics[f"relight/{measure}"]["value"] is None
        assert "sunset" in str(score.metrics[f"relight/{measure}"]["reason"])
        assert score.metrics[f"relight/overcast/{measure}"]["value"] is not None
        assert f"relight/sunset/{measure}" not in score.metrics


def test_a_missing_relit_view_leaves_the_metrics_of_the_other_views(scene: Scene, tmp_path: Path) -> None:
    WRITERS["irgs"](tmp_path, noisy(scene))
    (tmp_path / "test_rli_light/envmap_sunset/render/5.png").unlink()
    (score,) = score_predictions(read_predictions(tmp_path, scene), scene, [protocol("default")])
    assert [view is None for view in score.metrics["relight/psnr"]["views"]] == [place == 5 for place in range(8)]
    assert score.metrics["relight/psnr"]["value"] is None
    assert score.metrics["relight/overcast/psnr"]["value"] is not None


def test_the_mean_over_lights_equals_the_lights_mean(scene: Scene, tmp_path: Path) -> None:
    WRITERS["gs-ir"](tmp_path, noisy(scene))
    found = values(tmp_path, scene)
    lights = [found[f"relight/{light}/psnr"] for light in scene.lights]
    assert found["relight/psnr"] == pytest.approx(np.mean(lights), abs=1e-9)


def test_taking_a_white_ground_away_and_putting_it_back_changes_nothing(scene: Scene, tmp_path: Path) -> None:
    WRITERS["tensoir"](tmp_path, noisy(scene))
    view = scene.test[0]
    file = tmp_path / "imgs_test_all/nvs_with_brdf/000.png"
    generator = torch.Generator().manual_seed(1)
    # Anything may stand at soft edges and in the ground, also what is darker than the white that is taken away.
    any_image = torch.rand(view.camera.height, view.camera.width, 3, generator=generator)
    png(file, torch.cat([any_image, any_image], 1))
    stored = torch.from_numpy(read_image(file)[:, : view.camera.width].copy())
    on_white = truth(view, "image") + (1 - coverage(view))
    (score,) = score_predictions(read_predictions(tmp_path, scene), scene, [protocol("tensoir")])
    expected = psnr(stored, on_white)
    assert score.metrics["nvs/psnr"]["views"][0] == pytest.approx(expected, abs=1e-4)


def test_the_relighting_folder_of_tensoir_can_be_scored_alone(scene: Scene, tmp_path: Path) -> None:
    WRITERS["tensoir"](tmp_path, noisy(scene))
    assert likely_codes(tmp_path / "relighting") == ["tensoir"]
    alone, whole = values(tmp_path / "relighting", scene), values(tmp_path, scene)
    assert alone["relight/psnr"] == whole["relight/psnr"]
    assert "nvs/psnr" not in alone


def test_normals_end_where_the_predicted_coverage_does(scene: Scene, tmp_path: Path) -> None:
    """A floater beside the object counts where the protocol counts the whole image."""
    WRITERS["irgs"](tmp_path, noisy(scene))
    before = values(tmp_path, scene, under="irgs")["normal/mae"]
    view, base = scene.test[0], tmp_path / "test/ours_20000"
    alpha, normal = (torch.from_numpy(read_image(base / f"{kind}/00000.png")) for kind in ("rend_alpha", "rend_normal"))
    outside = coverage(view)[..., 0] == 0
    assert outside.any()
    alpha[outside], normal[outside] = 1.0, torch.tensor([0.5, 0.5, 0.0])
    png(base / "rend_alpha/00000.png", alpha)
    png(base / "rend_normal/00000.png", normal)
    after = values(tmp_path, scene, under="irgs")["normal/mae"]
    assert before is not None
    assert after is not None
    opposite = 180 * float(outside.float().mean()) / len(scene.test)
    assert after - before == pytest.approx(opposite, rel=0.01)


@pytest.mark.parametrize("empty", [0.5, 0.0])
def test_a_pixel_without_a_normal_is_a_hole_and_no_direction(empty: float, scene: Scene, tmp_path: Path) -> None:
    view = scene.test[0]
    png(tmp_path / f"normal/{view.name}.png", torch.full((view.camera.height, view.camera.width, 3), empty))
    normal = read_predictions(tmp_path, scene, "plain").read(view, coverage(view))["normal"]
    assert (normal == 0).all()


def test_a_recovered_light_is_scored_against_the_true_one(scene: Scene, tmp_path: Path) -> None:
    true_light = scene.training_light.radiance.numpy()
    np.save(tmp_path / "environment.npy", 3 * true_light)
    found = values(tmp_path, scene, "plain")
    assert found["environment/error"] == pytest.approx(4, abs=1e-5), "(3 - 1)^2"
    for name in ("error_scaled", "irradiance", "reflection", "floor"):
        assert found[f"environment/{name}"] == pytest.approx(0, abs=1e-6)
    np.save(tmp_path / "environment.npy", np.roll(true_light, 3, axis=1))
    turned = values(tmp_path, scene, "plain")["environment/error_scaled"]
    assert turned is not None
    assert turned > 0.01
    np.save(tmp_path / "environment.npy", -true_light)
    with pytest.raises(DataError, match="is not a light map"):
        values(tmp_path, scene, "plain")


def test_everything_that_is_left_out_is_named(scene: Scene, tmp_path: Path) -> None:
    WRITERS["gs-ir"](tmp_path, noisy(scene))
    for index in range(8):
        png(tmp_path / f"test/ours_None/extra/{index:05d}_odd.png", torch.zeros(4, 4, 3))
    (tmp_path / "chkpnt35000.pth").write_bytes(b"no pickle")
    (tmp_path / "cfg_args").write_text("Namespace()")
    assert read_predictions(tmp_path, scene).ignored == (
        "chkpnt35000.pth: checkpoints are not opened",
        "test/ours_None/extra/*_odd.png (8 files)",
    )


def images_of(scene: Scene) -> list[np.ndarray]:
    """The true images of the test views on black, 8-bit BGR."""
    return [
        np.rint(255 * (view.read("image") * view.read("alpha")).numpy())[..., ::-1].astype(np.uint8)
        for view in scene.test
    ]


@pytest.mark.parametrize(
    ("name", "lossless"),
    [
        ("TEST_{k:03}.PNG", True),
        ("renders/Test_{k:03}.Png", True),
        ("{k:03}.PNG", True),
        ("render/test_{k:03}.jpg", False),
        ("{k:05}.JPEG", False),
        ("test/ours_30000/renders/{k:05}.png", True),
        ("test/ours_30000/renders/test_{k:03}.jpg", False),
    ],
)
def test_images_of_any_case_ending_and_iteration_are_paired(
    name: str, lossless: bool, scene: Scene, tmp_path: Path
) -> None:
    for place, image in enumerate(images_of(scene)):
        for path in (name, name.replace("ours_30000", "ours_7000"))[: 1 + ("ours" in name)]:
            file = tmp_path / path.format(k=place)
            file.parent.mkdir(parents=True, exist_ok=True)
            written = image if path == name else image // 2
            file.write_bytes(cv2.imencode(file.suffix.lower(), written, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes())
    predictions = read_predictions(tmp_path, scene)
    found = values(tmp_path, scene)["nvs/psnr"]
    assert found is not None
    assert found > (60 if lossless else 35)
    assert any("are JPEG" in remark for remark in predictions.remarks) != lossless


@pytest.mark.parametrize(
    ("name", "wide", "first", "said"),
    [
        ("renders/{k:04}.png", 1, 1, "these run from 1 to 8.\nNumber them from 0 to 7"),
        ("{k}.png", 1, 1, "these run from 1 to 8.\nNumber them from 0 to 7"),
        ("{k:04}.png", 1, 3, "counts views up to 10, .*\n.*with another list each is of a wrong view"),
        (
            "renders/val_step29999_{k:04}.png",
            2,
            0,
            "val_step29999_0000.png has 192 x 96 pixels, the views 96 x 96: several",
        ),
        ("out/frame_{k}.png", 3, 0, "frame_0.png has 288 x 96 pixels"),
        ("color/{k:05}.png", 1, 0, "Give the folder that holds them: .*/color. Or call the images"),
        ("a/b/test_{k:03}.jpg", 1, 0, "Give the folder that holds them: .*/a/b. Or call"),
    ],
)
def test_a_refusal_lists_the_folders_content_and_a_remedy(
    name: str, wide: int, first: int, said: str, scene: Scene, tmp_path: Path
) -> None:
    for place, image in enumerate(images_of(scene), start=first):
        file = tmp_path / name.format(k=place)
        file.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(file), np.tile(image, (1, wide, 1)))
    with pytest.raises(DataError, match=said):
        read_predictions(tmp_path, scene)
