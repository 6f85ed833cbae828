import torch

from radiogs_core.learning.views import chosen_views, load, view_at
from scenes import sphere_scene


def test_every_epoch_shows_every_view_once() -> None:
    views = load(sphere_scene(views=5).train, torch.device("cpu"))
    for epoch in range(3):
        shown = {id(view_at(views, 5 * epoch + place, seed=3)) for place in range(5)}
        assert len(shown) == 5


def test_a_share_of_the_views_is_a_seeded_subset_in_order() -> None:
    scene = sphere_scene(views=8)
    half = chosen_views(scene, 0.5, seed=1)
    assert len(half) == 4
    assert half == chosen_views(scene, 0.5, seed=1)
    assert [view.name for view in half] == sorted(view.name for view in half)
    assert len(chosen_views(scene, 0.01, seed=1)) == 1


def test_compositing_covers_what_the_mask_leaves_open() -> None:
    view = load(sphere_scene().train[:1], torch.device("cpu"))[0]
    white = view.over(1.0)
    assert (white[view.mask == 0] == 1).all()
    torch.testing.assert_close(white[view.mask == 1], view.image[view.mask == 1])
