"""Mitsuba's renders agree with the conventions and formulas; skipped if Mitsuba cannot render."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_core.errors import UsageError
from radiogs_core.scene.light import EnvironmentMap
from radiogs_datasets import load_scene, scene_choices, scene_kind
from radiogs_datasets.generate import RECIPES, Pictures, generate_scene
from radiogs_datasets.generate.materials import Material, Patterned
from radiogs_datasets.generate.patterns import Stripes
from radiogs_datasets.generate.probe import mitsuba_failure
from radiogs_datasets.generate.solids import Sphere
from radiogs_datasets.generate.surfaces import surfaces_of
from radiogs_datasets.image_files import read_hdr, read_image
from radiogs_datasets.registry import TINY


@pytest.fixture(scope="module", autouse=True)
def _mitsuba() -> None:
    failure = mitsuba_failure()
    if failure is not None:
        pytest.skip(f"Mitsuba cannot render here: {failure}")
    from radiogs_datasets.generate import render

    render.start()


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes of few samples, 3 + 2 views of 12 x 12 pixels."""
    from radiogs_datasets import generate

    monkeypatch.setattr(generate.generate_scene, "__defaults__", (0, None, generate.Pictures(12, 3, 2, samples=16)))


def directions(count: int) -> np.ndarray:
    vectors = np.random.default_rng(0).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_the_light_that_is_rendered_is_the_light_that_is_looked_up() -> None:
    import drjit as dr
    import mitsuba as mi

    from radiogs_datasets.generate import render

    radiance = np.random.default_rng(1).random((16, 32, 3)).astype(np.float32)
    scene = render.build(RECIPES["convex"], radiance)
    towards = directions(2000)
    interaction = dr.zeros(mi.SurfaceInteraction3f, len(towards))
    interaction.wi = -mi.Vector3f(*towards.T)
    seen = np.array(scene.environment().eval(interaction)).T
    expected = EnvironmentMap(torch.from_numpy(radiance).double()).lookup(torch.from_numpy(towards))
    np.testing.assert_allclose(seen, expected.numpy(), atol=1e-4)


@pytest.mark.parametrize("roughness", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("cosine", [0.2, 0.9])
def test_brdf_samples_average_to_its_quadrature_and_its_density_to_one(roughness: float, cosine: float) -> None:
    import drjit as dr
    import mitsuba as mi

    from radiogs_datasets.generate.disney_bsdf import PLUGIN

    albedo = np.array([0.8, 0.5, 0.2])
    bsdf = mi.load_dict(
        {
            "type": PLUGIN,
            "albedo": {"type": "rgb", "value": albedo.tolist()},
            "roughness": {"type": "uniform", "value": roughness},
        }
    )
    count = 1 << 20
    view = np.array([math.sqrt(1 - cosine**2), 0.0, cosine])
    interaction = dr.zeros(mi.SurfaceInteraction3f, count)
    interaction.wi = mi.Vector3f(*view.tolist())
    random = np.random.default_rng(2).random((3, count)).astype(np.float32)
    sample, weight = bsdf.sample(mi.BSDFContext(), interaction, mi.Float(random[0]), mi.Point2f(*random[1:]), True)
    sampled = np.array(weight).mean(1)
    kept = (np.array(sample.pdf) > 0).mean()

    polar = (np.arange(1000) + 0.5) * (math.pi / 2 / 1000)
    azimuth = (np.arange(1000) + 0.5) * (2 * math.pi / 1000)
    polar, azimuth = (grid.ravel() for grid in np.meshgrid(polar, azimuth))
    light = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], -1)
    measure = np.sin(polar) * (math.pi / 2 / 1000) * (2 * math.pi / 1000)
    half = (light + view) / np.linalg.norm(light + view, axis=-1, keepdims=True)
    a2, k = roughness**4, (roughness + 1) ** 2 / 8
    ggx = a2 / (math.pi * (half[:, 2] ** 2 * (a2 - 1) + 1) ** 2)
    vh = half @ view
    fresnel = 0.04 + 0.96 * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    specular = ggx * fresnel / (4 * (cosine * (1 - k) + k) * (light[:, 2] * (1 - k) + k))
    expected = albedo + (specular * light[:, 2] * measure).sum()
    np.testing.assert_allclose(sampled, expected, rtol=0.005)

    interaction = dr.zeros(mi.SurfaceInteraction3f, len(light))
    interaction.wi = mi.Vector3f(*view.tolist())
    value, density = bsdf.eval_pdf(mi.BSDFContext(), interaction, mi.Vector3f(*light.T), True)
    assert (np.array(density) * measure).sum() == pytest.approx(kept, abs=0.005)
    wanted = (albedo[:, None] / math.pi + specular) * light[:, 2]
    np.testing.assert_allclose(np.array(value), wanted, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("name", ["niche", "knot", "print", "alcove", "sculpture", "crowd"])
def test_mitsuba_evaluates_the_true_surfaces_materials(name: str) -> None:
    """Patterns, and the normals of meshes: at the samples' middles, met from half a millimetre above."""
    import mitsuba as mi

    from radiogs_datasets.generate import render

    recipe = RECIPES[name]
    scene = render.build(recipe, np.ones((4, 8, 3), np.float32))
    samples = surfaces_of(recipe.solids, 0.03)
    normal = samples.frame[..., 2].numpy()
    start = samples.centre.numpy() + 5e-4 * normal
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*start.T), mi.Vector3f(*-normal.T)))
    # A ray along the diagonal of a box's face may slip between its two triangles.
    met = np.abs(np.array(hit.t) - 5e-4) < 2e-4
    assert met.mean() > 0.998
    assert (np.array(hit.n).T * normal).sum(-1)[met].min() > math.cos(math.radians(4))
    np.testing.assert_allclose(np.array(hit.sh_frame.n), np.array(hit.n), atol=1e-6)
    material = hit.bsdf()
    found = np.concatenate(
        [
            np.array(material.eval_attribute_3("albedo", hit)),
            np.array(material.eval_attribute_1("roughness", hit))[None],
        ]
    )
    expected = np.concatenate([samples.albedo.numpy(), samples.roughness.numpy()[:, None]], -1).T
    # The mesh lies up to 0.1 mm below the tube, and single precision decides otherwise at an edge.
    assert (np.abs(found - expected).max(0)[met] > 5e-3).mean() < 2e-3


@pytest.mark.parametrize("place", [0, 4])
def test_a_patterned_surface_reflects_like_plain_ones_of_its_materials(place: int) -> None:
    """A ball with 0 and 1 halves, under an even light: each pixel is one of two plain balls."""
    from radiogs_datasets.generate import render
    from radiogs_datasets.generate.recipe import pinhole

    one, other = Material((0.7, 0.2, 0.1), 0.3), Material((0.1, 0.3, 0.6), 0.8)
    finishes = (one, other, Patterned(one, other, Stripes((1.0, 0.0, 0.0), 4.0, 0.5)))
    recipe = RECIPES["convex"]
    camera = pinhole(recipe.rig, place, 24)
    light = np.ones((4, 8, 3), np.float32)
    scenes = [render.build(replace(recipe, solids=(Sphere((0.0, 0.0, 0.0), 1.0, each),)), light) for each in finishes]
    plain, second, patterned = (render.radiance(scene, camera, 64, 3, 0) for scene in scenes)
    seen = render.surface(scenes[2], camera)
    for chosen, expected in ((0.3, plain), (0.8, second)):
        whole = (seen.coverage[..., 0] == 1) & (np.abs(seen.roughness[..., 0] - chosen) < 1e-6)
        assert whole.sum() > 20
        np.testing.assert_allclose(patterned[whole], expected[whole], atol=2e-5)


def test_coverage_agrees_with_the_surface_maps() -> None:
    from radiogs_datasets.generate import render
    from radiogs_datasets.generate.recipe import pinhole

    recipe = RECIPES["wire"]
    scene, camera = render.build(recipe, np.ones((4, 8, 3), np.float32)), pinhole(recipe.rig, 3, 24)
    expected = render.surface(scene, camera).coverage > 0
    assert 0 < expected.mean() < 1
    assert np.array_equal(render.any_coverage(scene, camera), expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["convex", "knot", "print", "sculpture", "glossware"])
def test_the_generator_reproduces_the_committed_image(name: str, tmp_path: Path) -> None:
    from radiogs_datasets.generate import render, scene_folder
    from radiogs_datasets.generate.recipe import pinhole

    recipe, pictures = RECIPES[name], Pictures()
    lights = {"training": render.build(recipe, read_hdr(TINY / name / "envmaps/training.hdr"))}
    split = scene_folder.Split("train", 0, recipe.train, pictures.samples)
    scene_folder.write_view(lights, pinhole(recipe.rig, 0, pictures.size), split, pictures.depth, 0, tmp_path)
    difference = np.abs(read_image(tmp_path / "rgba.png") - read_image(TINY / name / "train_000/rgba.png"))
    # On the machine that made it, not a bit differs; elsewhere a fused multiply-add may round otherwise.
    assert difference.max() < 2.5 / 255


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_generation_is_deterministic_and_loads(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    generate_scene("corner", tmp_path / "first", 5, lambda *step: told.append(step))
    generate_scene("corner", tmp_path / "second", 5)
    assert told[-1] == ("test_001", 5, 5)
    files = sorted(path.relative_to(tmp_path / "first") for path in (tmp_path / "first").rglob("*") if path.is_file())
    exact = [path for path in files if path.suffix != ".exr"]
    assert len(files) > 20
    for path in exact:
        assert (tmp_path / "first" / path).read_bytes() == (tmp_path / "second" / path).read_bytes(), path
    first, second = (load_scene(str(tmp_path / name)) for name in ("first", "second"))
    for one, other in zip(first.test, second.test, strict=True):
        for name in one.sources:
            torch.testing.assert_close(one.read(name), other.read(name), rtol=0, atol=0)
        assert float(one.read("indirect").min()) >= 0
        assert float(one.read("indirect").max()) > 0
    assert first.train[0].camera.width == 12


@pytest.mark.slow
def test_the_recipe_says_how_many_views_and_of_which_kind_unless_another_number_is_asked_for(tmp_path: Path) -> None:
    for train, count in ((None, 24), (3, 3)):
        folder = tmp_path / str(count)
        generate_scene("front_patterned", folder, pictures=Pictures(12, train, 1, samples=4))
        scene = load_scene(str(folder))
        assert (len(scene.train), len(scene.test)) == (count, 1)
        assert scene.surfaces is not None
        assert scene_kind(str(folder)) == RECIPES["front_patterned"].kind
        assert scene_choices(str(folder)) == "reported only"


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_another_seed_gives_other_noise(tmp_path: Path) -> None:
    images = []
    for seed in (0, 1):
        generate_scene("convex", tmp_path / str(seed), seed)
        images.append(load_scene(str(tmp_path / str(seed))).train[0].read("image"))
    assert not torch.equal(*images)


@pytest.mark.usefixtures("small")
def test_a_folder_that_holds_something_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="exists already"):
        generate_scene("corner", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
