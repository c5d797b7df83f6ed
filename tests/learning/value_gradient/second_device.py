"""A second torch device for machines without one, and value gradients on it beside the CPU: a program of its own.

The device is torch's "privateuseone" in Python. Its tensors are known by their storage, of which there is one each, to
CPU tensors that hold the numbers; an operation that mixes them with tensors of the CPU is refused, as by a GPU.
torch takes all its tensors to be contiguous, from the first number of their storage on.
"""

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.utils._pytree import tree_map
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

from swimmer_mj.learning.networks.networks import Cascade, Multilayer, ValueNetwork
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.value_gradient.learner import ValueGradientLearner
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import PAPER

NAME = "second"
SIZE: dict[Any, Any] = {Multilayer: (8, 8), Cascade: 6}
TOLERANCE = {torch.float32: 1e-5, torch.float64: 1e-11}
"""Of weights below 1, speeds and controls.

The device's tensors are contiguous where the CPU's are transposed views, and products of matrices of another layout
are summed in another order: results differ by 3e-8 and 6e-17. What decides the sign of a control is 3e-4 of its terms
or more in all these rounds, so that rounding decides none.
"""
held: dict[int, tuple[Any, Tensor]] = {}  # a storage, which must live on, and the numbers


def on_device(numbers: Tensor) -> Tensor:
    tensor = torch._C._acc.create_empty_tensor(tuple(numbers.shape), numbers.dtype)
    storage = tensor.untyped_storage()
    held[storage._cdata] = storage, numbers
    return tensor


def numbers_of(tensor: Tensor) -> Tensor:
    return held[tensor.untyped_storage()._cdata][1]


def is_on_device(x: Any) -> bool:
    return isinstance(x, Tensor) and x.device.type == NAME


def operate(op: Any, *args: Any, **kwargs: Any) -> Any:
    """Any operation with tensors of the device, by those that hold their numbers."""
    name = str(op)
    if name.startswith("aten._copy_from"):
        source, target = (numbers_of(x) if is_on_device(x) else x for x in args[:2])
        target.copy_(source)
        return args[1]
    if name.startswith(("aten.view.default", "aten._reshape_alias", "aten._unsafe_view")):
        op, args = torch.ops.aten.reshape.default, args[:2]  # the strides are not those that torch knows
    operands: dict[int, Tensor] = {}

    def enter(x: Any) -> Any:
        if is_on_device(x):
            numbers = numbers_of(x)
            if name.startswith("aten.as_strided"):
                numbers = numbers if is_whole(numbers) else numbers.contiguous().clone()
            operands[id(numbers)] = x
            return numbers
        if isinstance(x, Tensor) and x.dim() > 0:
            raise RuntimeError(f"{name} mixes {x.device} with {NAME}")
        return torch.device("cpu") if isinstance(x, torch.device) else x

    result = op(*tree_map(enter, args), **tree_map(enter, kwargs))
    if name.startswith("aten._local_scalar"):
        return result

    def leave(y: Any) -> Any:
        if not isinstance(y, Tensor):
            return y
        return operands[id(y)] if id(y) in operands else on_device(y)  # changed in place, or new

    return tree_map(leave, result)


def is_whole(numbers: Tensor) -> bool:
    return numbers.is_contiguous() and numbers.storage_offset() == 0


def learn(network: ValueNetwork, device: str) -> list[np.ndarray]:
    """Some rounds, with a resume in between: weights, the speeds of episodes, controls."""
    problem = Swimming(PAPER)
    settings = ValueGradientSettings(trajectories=32, steps=4, minibatch=32, flips=0.1)
    learner = ValueGradientLearner(problem, network.to(device), settings, engine="torch")
    for _ in range(2):
        learner.step()
    state = learner.state_dict()
    learner = ValueGradientLearner(problem, network, settings, seed=1, engine="torch")
    learner.load_state_dict(state)
    learner.step()
    assert learner.policy().network.n_inputs == network.n_inputs
    starts = problem.initial_states(np.random.default_rng(3), 4)
    assert {w.device.type for w in network.parameters()} == {device}
    return [learner._weights.cpu().numpy(), learner.rollout(starts, 0.05), learner.control(starts)]


def main() -> None:
    torch.set_num_threads(1)
    _setup_privateuseone_for_python_backend(NAME)
    library = torch.library.Library("_", "IMPL")
    library.fallback(operate, "PrivateUse1")
    copy = Tensor.__deepcopy__

    def deep_copy(x: Tensor, memo: dict[int, Any]) -> Tensor:
        """Without the storage of a buffer, which has nothing in it."""
        buffer = is_on_device(x) and not isinstance(x, torch.nn.Parameter)
        return x.clone() if buffer else copy(x, memo)

    Tensor.__deepcopy__ = deep_copy

    there = torch.arange(4.0).to(NAME)
    assert (there[1:3] * 2).cpu().tolist() == [2, 4]
    with pytest.raises(RuntimeError, match="device"):
        there + torch.ones(4)
    m = Swimming(PAPER).n_inputs
    for make in (Multilayer, Cascade):
        for dtype in TOLERANCE:
            here, there = (
                learn(make(m, SIZE[make], generator=torch.Generator().manual_seed(0), dtype=dtype), device)
                for device in ("cpu", NAME)
            )
            for a, b in zip(here, there, strict=True):
                assert a.any()
                np.testing.assert_allclose(a, b, rtol=0, atol=TOLERANCE[dtype])
    print("the same within rounding")


if __name__ == "__main__":
    main()
