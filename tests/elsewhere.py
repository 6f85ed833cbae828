"""A fake device: its tensors lie in host memory, but cannot be combined with host tensors.

A second backend is registered with PyTorch (PrivateUse1, named "elsewhere"), so that tensors, autograd, generators and
optimisers take it for a real one. Whatever would fail on a GPU fails here: an operation on tensors of both, a generator
of the other, ``numpy()``, a kernel that is given arrays of both. Waits for a GPU are counted, by the line
of the program that causes them.
"""

import math
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

import pytest
import torch
import warp as wp
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

from radiogs_core.kernels.arguments import Arguments

NAME = "elsewhere"
ROOT = Path(__file__).parents[1]
ROOMS = tuple(str(ROOT / room) for room in ("method", "datasets", "baselines", "radiogs_bench"))
AWAITED = {"_local_scalar_dense", "nonzero", "masked_select", "equal", "bincount", "_unique2", "unique_dim", "item"}
"""Operations whose result's value or size the host needs."""


CAN_REGISTER = hasattr(torch.utils.backend_registration, "_setup_privateuseone_for_python_backend")
"""Whether this PyTorch takes a backend that is written in Python."""


def registered() -> torch.device:
    """The device, made known to PyTorch once in a process; a test skips where PyTorch cannot know it."""
    if not CAN_REGISTER:
        pytest.skip(f"PyTorch {torch.__version__} takes no backend that is written in Python")
    if torch._C._get_privateuse1_backend_name() != NAME:
        torch.utils.backend_registration._setup_privateuseone_for_python_backend(NAME)
    return torch.device(NAME, 0)


@dataclass
class Account:
    """Operations that the device was asked for."""

    operations: int = 0
    awaited: Counter[str] = field(default_factory=Counter)
    """How often the host waited for a value, by ``file:line function (operation)``."""

    def wait(self, operation: str) -> None:
        self.awaited[f"{_place()} ({operation})"] += 1

    @property
    def waits(self) -> int:
        """How often in all."""
        return sum(self.awaited.values())


def _place() -> str:
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and not frame.f_code.co_filename.startswith(ROOMS):
        frame = frame.f_back
    if frame is None:
        return "a test"
    return f"{Path(frame.f_code.co_filename).relative_to(ROOT)}:{frame.f_lineno} {frame.f_code.co_name}"


class There(torch.Tensor):
    """A tensor of the device; ``held`` is its memory."""

    held: torch.Tensor

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> "There":
        made = torch.Tensor._make_wrapper_subclass(
            cls,
            held.shape,
            strides=held.stride(),
            storage_offset=held.storage_offset(),
            dtype=held.dtype,
            device=registered(),
        )
        made.held = held
        return made

    def data_ptr(self) -> int:
        """The address of its memory, which a kernel may be given as a number."""
        return self.held.data_ptr()

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Files know no device: a checkpoint is read to where it is wanted."""
        return self.held.__reduce_ex__(protocol)

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        raise AssertionError(f"{func.name()} outside of elsewhere()")


GENERATOR = torch.Generator


class _Generator(GENERATOR):
    """A generator that records the device it was made for; operations receive it without its class."""

    known: ClassVar[dict[int, "_Generator"]] = {}

    def __new__(cls, device: torch.device | str = "cpu") -> "_Generator":
        made = GENERATOR.__new__(cls)
        made.made_for = torch.device(device)
        cls.known[made._cdata] = made
        return made

    @property
    def device(self) -> torch.device:
        return self.made_for


class _Operations(TorchDispatchMode):
    """Runs every operation in host memory, and refuses operations that a GPU would refuse."""

    def __init__(self, account: Account) -> None:
        super().__init__()
        self.account = account

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = func.name().split("::")[1].split(".")[0]
        kwargs = dict(kwargs or {})
        leaves = tree_flatten((args, kwargs))[0]
        given = [leaf for leaf in leaves if isinstance(leaf, torch.Tensor)]
        there = [leaf for leaf in given if isinstance(leaf, There)]
        here = [leaf for leaf in given if not isinstance(leaf, There)]
        asked = kwargs.get("device")
        on_device = bool(there) if asked is None else torch.device(asked).type == NAME
        if there and name != "copy_" and any(value.ndim for value in here):
            shapes = [tuple(value.shape) for value in here]
            raise AssertionError(f"{_place()}: {name} of tensors of the device and of the host {shapes}")
        if (generator := kwargs.get("generator")) is not None:
            of = _Generator.known[generator._cdata].device
            if (of.type == NAME) != on_device:
                raise AssertionError(f"{_place()}: {name} with a generator of {of}")
        if on_device or there:
            self.account.operations += 1
        if self._waits(name, there, args, on_device):
            self.account.wait(name)
        if on_device and asked is not None:
            kwargs["device"] = torch.device("cpu")
        held = tree_map(_held, (args, kwargs))
        known = {id(value.held): value for value in there}
        out = func(*held[0], **held[1])

        def moved(value: Any) -> Any:
            if not isinstance(value, torch.Tensor) or isinstance(value, There):
                return value
            return known.get(id(value)) if id(value) in known else There(value) if on_device else value

        return tree_map(moved, out)

    def _waits(self, name: str, there: list[There], args: Any, on_device: bool) -> bool:
        if not there:
            return False
        masks = name in ("index", "index_put_", "index_put", "_index_put_impl_") and any(
            mask is not None and mask.dtype == torch.bool for mask in args[1]
        )
        fetched = name == "_to_copy" and not on_device
        fetched |= name == "copy_" and not isinstance(args[0], There)
        return name in AWAITED or masks or fetched


class _Functions(TorchFunctionMode):
    """Calls that reach past PyTorch's dispatcher."""

    def __init__(self, account: Account) -> None:
        super().__init__()
        self.account = account

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        if func in (torch.tensor, torch.as_tensor, torch.asarray):
            device = kwargs.pop("device", None)
            made = func(*args, **kwargs)
            return made if device is None else made.to(device)
        if func is torch.Tensor.new_tensor:
            like = args[0]
            return torch.tensor(args[1], dtype=kwargs.get("dtype", like.dtype)).to(kwargs.get("device", like.device))
        if func is torch.Tensor.quantile and isinstance(args[0], There):
            return _quantile(*args, **kwargs)
        if func in (torch.Tensor.__getitem__, torch.Tensor.__setitem__):
            args = (args[0], _index_on(args[0].device, args[1]), *args[2:])
        if func is torch.Tensor.tolist and isinstance(args[0], There):
            self.account.wait("tolist")
            return args[0].held.tolist()
        return func(*args, **kwargs)


def _quantile(values: torch.Tensor, share: float) -> torch.Tensor:
    """PyTorch's own changes the shape of a tensor in place, which a wrapped one cannot follow."""
    ordered, place = values.flatten().sort().values, share * (values.numel() - 1)
    below = math.floor(place)
    return torch.lerp(ordered[below], ordered[min(below + 1, len(ordered) - 1)], place - below)


def _index_on(device: torch.device, index: Any) -> Any:
    """An index whose sequences of numbers are tensors."""
    parts = index if isinstance(index, tuple) else (index,)
    moved = tuple(torch.tensor(part).to(device) if isinstance(part, list | tuple) else part for part in parts)
    return moved if isinstance(index, tuple) else moved[0]


def _held(value: Any) -> Any:
    return value.held if isinstance(value, There) else value


@contextmanager
def elsewhere() -> Iterator[Account]:
    """In this block ``registered()`` works as a device."""
    registered()
    account = Account()
    device_from_torch, write = wp.device_from_torch, Arguments.write

    def written(arguments: Arguments, values: Sequence[Any]) -> None:
        arrays = [value for value in values if isinstance(value, torch.Tensor) and value.numel()]
        sides = {isinstance(value, There) for value in arrays}
        assert len(sides) <= 1, f"{_place()}: {arguments.kernel} is given arrays of the device and of the host"
        write(arguments, [_held(value) for value in values])

    def runs_on(device: torch.device) -> Any:
        return device_from_torch("cpu" if device.type == NAME else device)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Arguments, "write", written)
        patch.setattr(wp, "device_from_torch", runs_on)
        patch.setattr(torch, "Generator", _Generator)
        with _Operations(account), _Functions(account):
            yield account
    _Generator.known.clear()
