"""Training runs: what defines one, its directory, several together, and what it has learned.

- :mod:`~swimmer_mj.learning.runs.config`, :mod:`~swimmer_mj.learning.runs.registry`: a problem, a method and a seed,
  in Python, by name, and in config.json;
- :mod:`~swimmer_mj.learning.runs.run`, :mod:`~swimmer_mj.learning.runs.checkpoint`: a run and its directory;
- :mod:`~swimmer_mj.learning.runs.together`: several runs, in step or side by side;
- :mod:`~swimmer_mj.learning.runs.sweep`, :mod:`~swimmer_mj.learning.runs.jobs`,
  :mod:`~swimmer_mj.learning.runs.engines`: many runs of one question, on one machine or many;
- :mod:`~swimmer_mj.learning.runs.evaluation`: how good is it.
"""
