"""Any smooth MuJoCo model as a control problem."""

from swimmer_mj.learning.problems.mujoco.problem import MujocoProblem, Starts

__all__ = ["MujocoProblem", "Starts"]
