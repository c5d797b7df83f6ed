"""How fast is learning, and what does it spend its time on? Prints tables, writes JSON and a plot.

    python benchmarks/learning_speed.py [--quick]

measures the engines side by side, then the compiled ones against the number of neurons and of links, then each part of
a learning step alone. All take turns in one process, and the fastest turn counts: whatever else a machine does can
only slow it down. Rates are per second of wall-clock time; a learning step is a full one: dynamics, V and its
gradients, control, H, weights and traces.

Parts are timed in loops of their own in which each pass waits for the one before, as in learning. "Alone" are copies
of both passes through the network from which the update of weights and traces is taken out.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import tyro
from numba import njit
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from swimmer_mj.compiled.elementary import tanh_of_lanes, tanh_of_one
from swimmer_mj.compiled.vectors import FAST, LANES, add_lanes, load, multiply_add, splat, store
from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments.made import note_made
from swimmer_mj.learning.experiments.rates import (
    best_rates,
    fused,
    mj_step,
    on_all_cores,
    population,
    reference,
    swimming_learner,
    viscous_mj_step,
)
from swimmer_mj.learning.problems.forms import CompiledForm, LanesForm
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.td.population import PopulationTD
from swimmer_mj.parameters import PAPER, SwimmerParameters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw", "measure", "prepare", "report"]

ROOT = Path(__file__).parents[1]
DATA = ROOT / "benchmarks" / "results" / "learning-speed.json"
PLOT = ROOT / "docs" / "images" / "learning-speed.png"
NEURONS = (15, 30, 60, 120, 240)
LINKS = (3, 4, 5, 7, 10)
PASSES = 2000
"""Passes of a part in a row."""
ROUNDS = 3
"""Measurements of everything: how far they differ says how well the numbers are known."""

Work = Callable[[], int]
"""Does some, and returns how much."""
Real = NDArray[Any]

OPTIONS: dict[str, Any] = {"fastmath": FAST, "error_model": "numpy", "nogil": True}


def _problem(n_links: int) -> Swimming:
    return Swimming(SwimmerParameters(n_links=n_links))


def _of_a_turn(work: Callable[[int], int], seconds: float = 0.04) -> Work:
    """That work in a number of trials that keep a core for about ``seconds``: packing and unpacking is little then."""
    start = time.thread_time()
    work(1)
    trials = max(1, round(seconds / (time.thread_time() - start)))
    return lambda: work(trials)


def _fused_parts() -> dict[str, Work]:
    """Parts of one learner's step, 5 links and 60 neurons; a unit of work is one pass."""
    problem = Swimming(PAPER)
    learner = swimming_learner(0, problem)
    learner.train(problem.initial_states(np.random.default_rng(0), 2))
    constants, dynamics, _, inputs, _ = problem.form(CompiledForm)
    ws, kernel = learner._ws, learner._kernel
    forward, backward = kernel.forward, kernel.backward
    m = problem.n_inputs
    first = m + 1

    @njit(forceinline=True, **OPTIONS)
    def forward_alone(x: Real, ws: Any) -> float:
        P = ws.T.shape[1]
        hidden = ws.W.shape[0] - 1
        activation = ws.activation
        new = 1 - ws.now[0]
        ws.now[0] = new
        z = ws.z[new]
        inputs(x, z)
        z[m] = np.float32(1.0)
        for j in range(0, P, LANES):
            total = splat(np.float32(0.0))
            for k in range(first):
                total = multiply_add(splat(z[k]), load(ws.T, k * P + j), total)
            store(activation, j, total)
        activation_i = activation[0]
        for i in range(hidden):
            y_i = tanh_of_one(activation_i)
            ws.y[new, i] = y_i
            y = splat(y_i)
            activation_i = activation[i + 1]
            for j in range((i + 1) // LANES * LANES, P, LANES):
                w = load(ws.T, (first + i) * P + j)
                store(activation, j, multiply_add(y, w, load(activation, j)))
            activation_i += y_i * ws.T[first + i, i + 1]
        return activation_i

    @njit(forceinline=True, **OPTIONS)
    def backward_alone(ws: Any) -> None:
        n, R = ws.W.shape
        P = ws.T.shape[1]
        hidden = n - 1
        gradient = ws.gradient
        new = ws.now[0]
        ws.delta[new, hidden] = np.float32(1.0)
        for j in range(0, R, LANES):
            store(gradient, j, load(ws.W, hidden * R + j))
        gradient_i = gradient[hidden - 1]
        for i in range(hidden - 1, -1, -1):
            y_i = ws.y[new, i]
            delta_i = (np.float32(1.0) - y_i * y_i) * gradient_i
            ws.delta[new, i] = delta_i
            slope = splat(delta_i)
            gradient_i = gradient[max(i - 1, 0)]
            for j in range(0, i, LANES):
                store(gradient, j, multiply_add(slope, load(ws.W, i * R + j), load(gradient, j)))
            gradient_i += delta_i * ws.W[i, max(i - 1, 0)]
        for k in range(m):
            total = load(ws.T, k * P) * load(ws.delta, new * P)
            for j in range(LANES, P, LANES):
                total = multiply_add(load(ws.T, k * P + j), load(ws.delta, new * P + j), total)
            ws.dVdz[k] = add_lanes(total)

    # ``zero`` is unknown to the compiler: a pass waits for the one before, and changes nothing that it reads.
    def forwards(one_pass: Any) -> Any:
        @njit(**OPTIONS)
        def loop(count: int, zero: float, x: Real, ws: Any) -> None:
            for _ in range(count):
                x[0] += zero * one_pass(x, ws)

        return loop

    def backwards(one_pass: Any) -> Any:
        @njit(**OPTIONS)
        def loop(count: int, zero: float, x: Real, ws: Any) -> None:
            last = ws.W.shape[0] - 2
            for _ in range(count):
                one_pass(ws)
                ws.y[ws.now[0], last] += zero * ws.dVdz[0]

        return loop

    @njit(**OPTIONS)
    def drifts(count: int, zero: float, x: Real, ws: Any, constants: Any) -> None:
        for _ in range(count):
            dynamics(constants, x, ws.a, ws.B)
            for i in range(x.size):
                x[i] += zero * ws.a[i]

    @njit(forceinline=True, **OPTIONS)
    def update(
        w: Real, e: Real, sources: Real, rate: Real, delta: Real, dt_H: Any, decay: Any, step: Any
    ) -> None:
        """Euler step of all weights and traces by source; ``sources`` has one number for each row."""
        rows, width = w.shape
        for k in range(rows):
            d = splat(step * sources[k])
            for j in range(0, width, LANES):
                trace = load(e, k * width + j)
                gain = splat(dt_H) * load(rate, j)
                store(w, k * width + j, multiply_add(gain, trace, load(w, k * width + j)))
                store(e, k * width + j, multiply_add(splat(decay), trace, d * load(delta, j)))

    @njit(**OPTIONS)
    def updates(
        count: int, zero: float, x: Real, ws: Any, sources: Real, delta: Real, one: np.float32
    ) -> None:
        for _ in range(count):
            update(ws.T, ws.T_trace, sources, ws.rate, delta, np.float32(zero), one, np.float32(zero))
            update(ws.W, ws.W_trace, delta, ws.rate, sources, np.float32(zero), one, np.float32(zero))

    @njit(**OPTIONS)
    def chain(count: int, zero: float, x: Real, ws: Any, bias: np.float32, weight: np.float32) -> None:
        """Only what cannot be done at the same time: the hidden neurons' tanh and multiply-add, one by one."""
        a = np.float32(x[0])
        for _ in range(count * (ws.W.shape[0] - 1)):
            a = bias + tanh_of_one(a) * weight
        x[0] += zero * a

    x = problem.initial_states(np.random.default_rng(1), 1)[0]

    def work(loop: Any, *more: Any) -> Work:
        def passes() -> int:
            loop(PASSES, 0.0, x, ws, *more)
            return PASSES

        passes()
        return passes

    return {
        "dynamics": work(drifts, constants),
        "forward": work(forwards(forward)),
        "backward": work(backwards(backward)),
        "forward alone": work(forwards(forward_alone)),
        "backward alone": work(backwards(backward_alone)),
        "update alone": work(updates, np.ones(128, np.float32), np.ones(128, np.float32), np.float32(1.0)),
        "chain of tanh": work(chain, np.float32(0.3), np.float32(0.5)),
    }


def _population_parts() -> dict[str, Work]:
    """Parts of the step of a pack of learners; a unit of work is one pass of one learner."""
    problem = Swimming(PAPER)
    pack = PopulationTD([swimming_learner(lane, problem) for lane in range(LANES)])
    states = problem.initial_states(np.random.default_rng(0), LANES)
    pack.train(states[None])
    lanes = problem.form(LanesForm)
    assert lanes is not None
    constants, greedy = lanes.constants, lanes.greedy
    ws, forward, backward = pack._ws, pack._kernel.forward, pack._kernel.backward
    n, m = pack.learners[0].network.n_neurons, problem.n_inputs
    first = m + 1

    @njit(**OPTIONS)
    def forward_alone(n: int, old: int, new: int, ws: Any) -> None:
        S = (m + n) * LANES
        o = 0
        for i in range(n):
            even = odd = splat(np.float32(0.0))
            for j in range(first + i):
                even, odd = (
                    odd,
                    multiply_add(load(ws.source, new * S + j * LANES), load(ws.weight, o), even),
                )
                o += LANES
            total = multiply_add(splat(np.float32(1.0)), even, odd)
            if i == n - 1:
                store(ws.gradient, 0, total)
            else:
                store(ws.source, new * S + (first + i) * LANES, tanh_of_lanes(total))

    def forwards(one_pass: Any) -> Any:
        @njit(**OPTIONS)
        def loop(count: int, n: int, ws: Any) -> None:
            for k in range(count):
                one_pass(n, k % 2, 1 - k % 2, ws)

        return loop

    @njit(**OPTIONS)
    def backwards(count: int, n: int, ws: Any) -> None:
        for _ in range(count):
            backward(n, 0, ws)

    @njit(**OPTIONS)
    def drifts(count: int, n: int, ws: Any, constants: Any, limits: Real) -> None:
        """Greedy control, f and r: the dynamics of a pack leave out the control matrix."""
        x, f, u, dVdx, _, _, r = ws.lanes
        for _ in range(count):
            greedy(constants, limits, x, dVdx, u, f, r)

    def work(loop: Any, *more: Any) -> Work:
        def passes() -> int:
            loop(PASSES // 4, n, ws, *more)
            return PASSES // 4 * LANES

        passes()
        return passes

    return {
        "dynamics": work(drifts, constants, problem.control_limits),
        "forward": work(forwards(forward)),
        "backward": work(backwards),
        "forward alone": work(forwards(forward_alone)),
    }


def prepare(neurons: tuple[int, ...], links: tuple[int, ...], pool: ThreadPoolExecutor) -> dict[str, Work]:
    """All there is to time, compiled, by name: ``engines/...``, ``neurons/15/...``, ``links/3/...``, ``parts/...``."""
    cores = os.cpu_count() or 1

    def one(seed: int) -> Work:
        return _of_a_turn(fused(seed))

    def pack(seed: int) -> Work:
        return _of_a_turn(population(seed))

    works: dict[str, Work] = {
        "engines/mj_step": mj_step(0.0),
        "engines/mj_step_viscous": viscous_mj_step(),
        "engines/reference": reference(),
        "engines/fused": one(0),
        "engines/fused_all_cores": on_all_cores(one, pool, cores),
        "engines/population": pack(0),
        "engines/population_all_cores": on_all_cores(pack, pool, cores),
    }
    for count in neurons:
        works[f"neurons/{count}/fused"] = _of_a_turn(fused(0, neurons=count))
        works[f"neurons/{count}/population"] = _of_a_turn(population(0, neurons=count))
    for count in links:
        works[f"links/{count}/mj_step"] = mj_step(0.0, count)
        works[f"links/{count}/fused"] = _of_a_turn(fused(0, _problem(count)))
        works[f"links/{count}/population"] = _of_a_turn(population(0, _problem(count)))
    works |= {f"parts/fused/{name}": work for name, work in _fused_parts().items()}
    works |= {f"parts/population/{name}": work for name, work in _population_parts().items()}
    return works


def measure(works: Mapping[str, Work], seconds: float) -> list[dict[str, float]]:
    """Their rates, 1/s, in each of :data:`ROUNDS` equal parts of ``seconds``."""
    return [best_rates(works, seconds / ROUNDS) for _ in range(ROUNDS)]


def _memory(neurons: int) -> dict[str, float]:
    """KiB of weights and traces in float32: of the connections that exist, of a fused learner, of a pack."""
    learner = swimming_learner(0, neurons=neurons)
    ws, pack = learner._ws, PopulationTD([learner])._ws
    of_fused = ws.T, ws.T_trace, ws.W, ws.W_trace
    return {
        "connections": 4 * 2 * int(learner.network.connected.sum()) / 1024,
        "fused": sum(array.nbytes for array in of_fused) / 1024,
        "population": (pack.weight.nbytes + pack.trace.nbytes) / 1024,
    }


def _cache(index: int) -> str | None:
    """Size of a cache of the first core, where Linux says: 0 is L1 for data, 2 is L2."""
    path = Path(f"/sys/devices/system/cpu/cpu0/cache/index{index}/size")
    return path.read_text().strip() if path.exists() else None


def _machine() -> dict[str, Any]:
    info = Path("/proc/cpuinfo")
    names = (
        [line for line in info.read_text().splitlines() if line.startswith("model name")]
        if info.exists()
        else []
    )
    return {
        "processor": names[0].partition(": ")[2] if names else platform.processor(),
        "cores": os.cpu_count(),
        "L1": _cache(0),
        "L2": _cache(2),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numba", "llvmlite", "numpy", "torch", "mujoco")},
    }


def report(rounds: Sequence[Mapping[str, float]], seconds: float) -> dict[str, Any]:
    """What goes into the JSON.

    Rates in 1/s, the highest of all rounds; ``parts`` in microseconds of one learner's step, the lowest; memory in
    KiB; ``rounds``: the engines' rates in each round.
    """
    rates = {name: max(rates[name] for rates in rounds) for name in rounds[0]}
    nested: dict[str, Any] = {"machine": _machine(), "seconds": seconds}
    for name, rate in rates.items():
        *path, last = name.split("/")
        place = nested
        for key in path:
            place = place.setdefault(key, {})
        place[last] = 1e6 / rate if path[0] == "parts" else rate
    nested["rounds"] = {name: [rates[f"engines/{name}"] for rates in rounds] for name in nested["engines"]}
    for engine, parts in nested["parts"].items():
        parts["step"] = 1e6 / rates[f"engines/{engine}"]
        parts["rest"] = parts["step"] - sum(parts[name] for name in ("dynamics", "forward", "backward"))
    nested["memory_KiB"] = {count: _memory(int(count)) for count in nested["neurons"]}
    return nested


def draw(data: Mapping[str, Any]) -> Figure:
    """Steps per second against neurons and against links, of what :func:`report` returns."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    from swimmer_mj.render.figures import BLUE, GREY, INK, ORANGE, plain_axes

    lines = {
        "population": (ORANGE, "s-", "16 learners in SIMD lanes, together"),
        "fused": (BLUE, "o-", "one learner"),
        "mj_step": (GREY, "--", "bare mj_step, for comparison"),
    }
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    bare = data["engines"]["mj_step"]
    neurons = {int(count): rates | {"mj_step": bare} for count, rates in data["neurons"].items()}
    links = {int(count): rates for count, rates in data["links"].items()}
    panels = ((left, neurons, "neurons (5 links)"), (right, links, "links (60 neurons)"))
    for axes, rows, label in panels:
        plain_axes(axes)
        axes.set_xscale("log")
        axes.set_yscale("log")
        for name, (color, style, text) in lines.items():
            rates = [row[name] for row in rows.values()]
            axes.plot(list(rows), rates, style, color=color, label=text, markersize=5, linewidth=1.6)
        axes.xaxis.set_major_locator(FixedLocator(list(rows)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel(label, color=INK)
        axes.margins(x=0.05, y=0.08)
    ticks = [value * 10**power for power in range(3, 8) for value in (1, 2, 5)]
    left.yaxis.set_major_locator(FixedLocator(ticks))
    left.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    left.yaxis.set_minor_formatter(NullFormatter())
    left.set_ylabel("steps per second of one core", color=INK)
    left.legend(frameon=False, loc="lower left", fontsize=9)
    return figure


def _ratio(rate: float, bare: float) -> str:
    return f"{rate:,.0f} ({rate / bare:.3g})"


def _print(data: Mapping[str, Any]) -> None:
    console = Console()
    bare = data["engines"]["mj_step"]
    table = Table("", "1/s (per bare mj_step)", "in each round", title="Engines, 5 links, 60 neurons")
    for name, rate in data["engines"].items():
        rounds = (f"{of_round:,.0f}" for of_round in data["rounds"][name])
        table.add_row(name, _ratio(rate, bare), " ".join(rounds))
    console.print(table)
    for title in ("neurons", "links"):
        table = Table(title, "mj_step", "fused", "population", title="1/s (per bare mj_step)")
        for count, row in data[title].items():
            own = row.get("mj_step", bare)
            table.add_row(count, f"{own:,.0f}", _ratio(row["fused"], own), _ratio(row["population"], own))
        console.print(table)
    for engine, parts in data["parts"].items():
        table = Table("part", "µs", title=f"A step of one learner, {engine}")
        for name, microseconds in parts.items():
            table.add_row(name, f"{microseconds:.3f}")
        console.print(table)
    table = Table("neurons", "connections", "fused", "population", title="Weights and traces, KiB")
    for count, row in data["memory_KiB"].items():
        table.add_row(count, *(f"{value:,.0f}" for value in row.values()))
    console.print(table)


def main(
    out: Path = DATA, plot: Path = PLOT, seconds: float = 150.0, quick: bool = False, redraw: bool = False
) -> None:
    """Compile, measure, print, write.

    Args:
        out: Where the JSON goes.
        plot: Where the plot goes.
        seconds: How long turns are taken, after some minutes of compilation.
        quick: Three sizes each, 10 s; writes to runs/benchmarks/ unless told where.
        redraw: Only draw what is in the JSON again.
    """
    from swimmer_mj.render.figures import save_figure

    torch.set_num_threads(1)
    neurons, links = NEURONS, LINKS
    if quick:
        neurons, links, seconds = (15, 60, 240), (3, 5), min(seconds, 10.0)
        runs = Path("runs") / "benchmarks"
        out = runs / DATA.name if out == DATA else out
        plot = runs / PLOT.name if plot == PLOT else plot
    if not redraw:
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            rounds = measure(prepare(neurons, links, pool), seconds)
        with replacing(out) as partial:
            partial.write_text(json.dumps(report(rounds, seconds), indent=2) + "\n", encoding="utf-8")
        note_made(out)
    data = json.loads(out.read_text(encoding="utf-8"))
    _print(data)
    save_figure(draw(data), plot)


if __name__ == "__main__":
    tyro.cli(main)
