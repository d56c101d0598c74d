"""QPs and strict hierarchies of least squares, with backends by name."""

from rcmqp.errors import InvalidProblem, SolverNotInstalled, WrongShape
from rcmqp.qp.hierarchy import Hierarchy, hierarchy_backends
from rcmqp.qp.levels import Bounds, HierarchySolution, Level, LevelResult, Route
from rcmqp.qp.problem import QP, KKTResiduals, QPSolution, QPSolver, Status, kkt_residuals
from rcmqp.qp.solvers import get_solver, solver_names

__all__ = [
    "QP",
    "Bounds",
    "Hierarchy",
    "HierarchySolution",
    "InvalidProblem",
    "KKTResiduals",
    "Level",
    "LevelResult",
    "QPSolution",
    "QPSolver",
    "Route",
    "SolverNotInstalled",
    "Status",
    "WrongShape",
    "get_solver",
    "hierarchy_backends",
    "kkt_residuals",
    "solver_names",
]
