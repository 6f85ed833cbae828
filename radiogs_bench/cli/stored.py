"""``radiogs-bench status`` and ``report``: what is in a folder, and its tables and figures anew."""

import argparse


def status(options: argparse.Namespace) -> int:
    """Show the state of every cell of the folder's last run."""
    from rich.table import Table

    from ..store import Store
    from ..sweep import label, read_sweep, state_of
    from .reporter import say, show

    store, sweep = Store(options.out), read_sweep(options.out)
    table = Table("cell", "key", "state", title=f"{sweep['title']}, preset {sweep['preset']}")
    states = [state_of(store, place) for place in sweep["cells"]]
    for place, state in zip(sweep["cells"], states, strict=True):
        table.add_row(label(place), place["key"], state)
    show(table)
    say(f"{states.count('finished')} of {len(states)} cells finished")
    mine = {place["key"] for place in sweep["cells"]}
    others = sum(1 for result in store.results() if result["key"] not in mine)
    if others:
        say(f"{others} finished cells of other runs or versions of the code are kept beside them")
    return 0


def report(options: argparse.Namespace) -> int:
    """Rebuild tables and figures from the stored results."""
    from ..store import Store
    from .showing import write_and_show

    write_and_show(Store(options.out))
    return 0
