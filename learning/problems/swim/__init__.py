"""Swimming, section 4, in all its forms.

- :mod:`~swimmer_mj.learning.problems.swim.swimming`: the problem, in NumPy;
- :mod:`~swimmer_mj.learning.problems.swim.reduced`: the equations of its reduced variables, and their constants;
- :mod:`~swimmer_mj.learning.problems.swim.torch_form`, :mod:`~swimmer_mj.learning.problems.swim.scalar`,
  :mod:`~swimmer_mj.learning.problems.swim.lanes`, :mod:`~swimmer_mj.learning.problems.swim.batched`: in torch, compiled
  for one state, for a state in each SIMD lane, and for batches of trajectories
  (:mod:`~swimmer_mj.learning.problems.swim.batched_equations`,
  :mod:`~swimmer_mj.learning.problems.swim.batched_costates`);
- :mod:`~swimmer_mj.learning.problems.swim.environment`: the dm_control task in which it is judged, and may be learned.
"""

from swimmer_mj.learning.problems.swim.swimming import Swimming

__all__ = ["Swimming"]
