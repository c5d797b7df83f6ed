"""The jobs of a sweep as an array of SLURM jobs, each of which has a part of them learn on one core.

Nothing is learned here: a script for ``sbatch`` is written. A job of the array that is stopped before its time limit,
preempted, or lost with its node is put into the queue again, and goes on from its runs' last checkpoints. The array
reads a copy of the sweep's file, so that editing the file changes nothing for jobs that wait.
"""

from __future__ import annotations

import hashlib
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swimmer_mj.files import replacing
from swimmer_mj.learning.runs.jobs import Job, News, packs, part, unfinished

__all__ = ["MOST_PARTS", "SCRIPT", "SlurmEngine"]

SCRIPT = "sweep.sbatch"
MOST_PARTS = 1000
"""Jobs in an array: SLURM's MaxArraySize is 1001, if a site has not set another."""
NOTICE = 120
"""s before the time limit at which a job is stopped, so that it can save."""

_TEMPLATE = """\
#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --array={indices}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --requeue
#SBATCH --signal=TERM@{notice}
#SBATCH --open-mode=append
#SBATCH --chdir={folder}
#SBATCH --output={log}
# Time limit, partition and account are sbatch's options: sbatch --time=4:00:00 --partition=... {script}
export OMP_NUM_THREADS=1
srun --ntasks=1 --cpus-per-task=1 {command} --part "$SLURM_ARRAY_TASK_ID/{n}"
status=$?
if [ "$status" -eq 143 ]; then # SIGTERM: it has saved, and goes on when it is its turn again
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
fi
exit "$status"
"""


@dataclass(frozen=True)
class SlurmEngine:
    """An array of jobs for SLURM.

    Parameters
    ----------
    file : Path
        What the sweep is asked for, as TOML.
    modules : tuple of str
        Modules of one's own that the file needs.
    parts : int, optional
        Jobs of the array: by default as few as hold all runs, those that learn in step together, at most
        :data:`MOST_PARTS`. More of them end sooner and cost more in all.
    """

    file: Path
    modules: tuple[str, ...] = ()
    parts: int | None = None

    def __post_init__(self) -> None:
        if self.parts is not None and not 1 <= self.parts <= MOST_PARTS:
            raise ValueError(f"parts must be from 1 to {MOST_PARTS:,}, got {self.parts}")

    def run(
        self,
        jobs: Sequence[Job],
        directory: Path,
        trials: int,
        report: Callable[[News], None],
        stop: Callable[[], bool],
    ) -> None:
        """Write the script for what is left of ``jobs``; see :class:`~swimmer_mj.learning.runs.jobs.Engine`."""
        n = min(self.parts or MOST_PARTS, len(packs(jobs, self.parts or 1)))
        left = {job.name for job in unfinished(jobs, directory, trials)}
        indices = [k for k in range(1, n + 1) if any(job.name in left for job in part(jobs, k, n))]
        if not indices:
            return
        directory, content = directory.absolute(), self.file.read_bytes()
        copy = directory / "slurm" / f"{hashlib.sha256(content).hexdigest()[:12]}.toml"
        with replacing(copy) as partial:
            partial.write_bytes(content)
        command = [sys.executable, "-m", "swimmer_mj", "sweep", str(copy), "--out", str(directory)]
        command += ["--trust", *self.modules] if self.modules else []
        script = _TEMPLATE.format(
            name=shlex.quote(f"sweep-{self.file.stem}"),
            indices=ranges(indices),
            notice=NOTICE,
            folder=shlex.quote(str(Path.cwd())),
            log=shlex.quote(str(directory / "slurm" / "%a.log")),
            script=SCRIPT,
            command=shlex.join(command),
            n=n,
        )
        with replacing(directory / SCRIPT) as partial:
            partial.write_text(script, encoding="utf-8")


def ranges(numbers: Sequence[int]) -> str:
    """Ascending integers as SLURM writes them: "1-3,7"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ",".join("-".join(map(str, run)) for run in runs)
