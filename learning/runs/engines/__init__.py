"""Where the jobs of a sweep learn: the engines, a module each (:class:`swimmer_mj.learning.runs.jobs.Engine`).

- :mod:`~swimmer_mj.learning.runs.engines.local`: on this machine;
- :mod:`~swimmer_mj.learning.runs.engines.ray_core`: on a Ray cluster;
- :mod:`~swimmer_mj.learning.runs.engines.slurm`: as an array of SLURM jobs, each of which is the local engine.
"""
