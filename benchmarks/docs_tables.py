"""The tables of measured numbers in the README and the docs, written from the logs.

    python benchmarks/docs_tables.py          # write them into the pages
    python benchmarks/docs_tables.py --check  # only say which pages do not have what the logs say; exit status 1

A page has a table between ``<!-- table: NAME -->`` and ``<!-- end -->``; :data:`TABLES` says how NAME is made. Nothing
is measured here: each log is written by a command of its own.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import gait_tables
import measured
import model_tables
import tables
import tournament_results
import turning
import tyro

from swimmer_mj.files import replacing
from swimmer_mj.learning.experiments import LOGS, summaries
from swimmer_mj.learning.experiments.claims import claims

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
MARKED = re.compile(r"(<!-- table: ([\w.-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def experiment(name: str) -> str:
    """As ``swimmer-mj figures NAME`` prints it."""
    return summaries.TABLES[name](LOGS).markdown()


def result(make: Callable[[], summaries.Summary]) -> str:
    """Of a benchmark."""
    return make().markdown()


RESULTS: dict[str, Callable[[], summaries.Summary]] = {
    "learners": tables.learners,
    "value-gradient-seeds": tables.value_gradient_seeds,
    "changed-swimmers": tables.changed_swimmers,
    "measured": measured.measured,
    "headlines": measured.headlines,
    "policies": tables.policies,
    "interval-coverage": tables.coverage,
    "engines": tables.engines,
    "neurons": partial(tables.against, "neurons"),
    "links": partial(tables.against, "links"),
    "parts-fused": partial(tables.parts, "fused"),
    "parts-population": partial(tables.parts, "population"),
    "memory": tables.memory,
    "devices": tables.devices,
    "device-speeds": tables.device_speeds,
    "gaits": gait_tables.replays,
    "gait-accelerations": gait_tables.accelerations,
    "gait-basins": gait_tables.basins,
    "gait-shares": gait_tables.shares,
    "ways-out": gait_tables.ways_out,
    "any-model": model_tables.any_model,
    "task-settings": model_tables.task_settings,
    "round-cost": model_tables.round_cost,
    "any-model-variants": model_tables.any_model_variants,
    "td-on-mujoco": model_tables.td_on_mujoco,
    "own-models": model_tables.own_models,
    "swimmer-as-mjcf": model_tables.swimmer_as_mjcf,
    "swimmer-coordinates": model_tables.swimmer_coordinates,
    "several-seeds": model_tables.several_seeds,
    "solid-links": model_tables.solid_links,
    "reacher-bound": model_tables.reacher_bound,
    "linear-policies": model_tables.linear_policies,
    "jacobian-cost": model_tables.jacobian_cost,
    "cluster-scale": tables.cluster_scale,
    "run-cost": tables.run_cost,
    "tournament-against": tournament_results.against_the_fastest,
    "tournament-against-thrifty": partial(tournament_results.against_the_fastest, mine="ours-thrifty"),
    "tournament-final": tournament_results.finals,
    "tournament-tuning": tournament_results.tuning,
    "planners": tables.planners,
    "platforms": tables.platforms,
    "logs": tables.logs_made,
    "start-up": tables.start_up,
    "open-loop-wave": tables.open_loop_wave,
    "turning": turning.summary,
    "long-runs": partial(tables.long_runs, LOGS),
}

TABLES: dict[str, Callable[[], str]] = {
    **{name: partial(experiment, name) for name in summaries.TABLES},
    "claims": lambda: claims().markdown(),
    "killed-node": tables.killed_node,
    **{name: partial(result, make) for name, make in RESULTS.items()},
}
"""Each in Markdown, by the name in its mark."""


def with_tables(text: str) -> str:
    """The text of a page with its tables as the logs have them."""

    def table(match: re.Match[str]) -> str:
        name = match[2]
        if name not in TABLES:
            raise ValueError(f"there is no table {name!r}; there are {', '.join(TABLES)}")
        return f"{match[1]}\n{TABLES[name]()}\n{match[4]}"

    if text.count("<!-- table:") != len(MARKED.findall(text)):
        raise ValueError("a table's mark has no <!-- end -->")
    return MARKED.sub(table, text)


def main(check: bool = False) -> None:
    """Write the tables.

    Args:
        check: Write nothing; say which pages differ, and exit with 1 if there are any.
    """
    stale = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if (new := with_tables(text)) != text:
            stale.append(str(page.relative_to(ROOT)))
            if not check:
                with replacing(page) as partial_page:
                    partial_page.write_text(new, encoding="utf-8")
    if stale:
        print(f"{'not as the logs say' if check else 'written'}: {', '.join(stale)}")
    if check and stale:
        raise SystemExit(1)


if __name__ == "__main__":
    tyro.cli(main)
