"""Any smooth MuJoCo model as a control problem."""

from swimmer_mj.learning.problems.mujoco.problem import MujocoProblem
from swimmer_mj.learning.problems.mujoco.starts import Starts

__all__ = ["MujocoProblem", "Starts"]
