"""Counts that lie on a device are added up there, and read together."""

import torch

from elsewhere import elsewhere, registered
from radiogs_core.instruments import Tally


def test_counts_of_host_and_device_add_up_and_are_awaited_once() -> None:
    there, tally = registered(), Tally({"rays": 1})
    with elsewhere() as account:
        for amount in (2, 3):
            tally.add({"rays": 10 * amount, "hits": torch.tensor(amount, device=there)})
        tally.add({"lobes": torch.tensor(7, device=there)})
        before = account.waits
        found = dict(tally.read())
        assert account.waits <= before + 1
    assert found == {"rays": 51, "hits": 5, "lobes": 7}
