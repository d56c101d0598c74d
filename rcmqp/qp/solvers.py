"""QP backends by name, imported only when asked for.

``proxqp`` and ``daqp`` are native; every other name goes through qpsolvers.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rcmqp.errors import OptionError, SolverNotInstalled, UnknownName
from rcmqp.qp.problem import QPSolver

_NATIVE = {"proxqp": ("rcmqp.qp.proxqp_", "ProxQP"), "daqp": ("rcmqp.qp.daqp_", "DAQP")}

_PACKAGES = {
    "proxqp": ("proxsuite", "proxsuite"),
    "daqp": ("daqp", "daqp"),
    "clarabel": ("clarabel", "clarabel"),
    "copt": ("coptpy", "coptpy"),
    "cvxopt": ("cvxopt", "cvxopt"),
    "ecos": ("ecos", "ecos"),
    "gurobi": ("gurobipy", "gurobipy"),
    "highs": ("highspy", "highspy"),
    "jaxopt_osqp": ("jaxopt", "jaxopt"),
    "kvxopt": ("kvxopt", "kvxopt"),
    "mosek": ("mosek", "mosek"),
    "osqp": ("osqp", "osqp"),
    "piqp": ("piqp", "piqp"),
    "qpalm": ("qpalm", "qpalm"),
    "qpax": ("qpax", "qpax"),
    "qpoases": ("qpoases", "qpoases"),
    "qpswift": ("qpSWIFT", "qpSWIFT"),
    "quadprog": ("quadprog", "quadprog"),
    "scs": ("scs", "scs"),
}
"""Solver name: (module to look for, what to pip install)."""


def solver_names() -> list[str]:
    """Names of the solvers whose packages are installed; nothing is imported for it."""
    has_qpsolvers = importlib.util.find_spec("qpsolvers") is not None
    return [
        name
        for name, (module, _) in _PACKAGES.items()
        if (name in _NATIVE or has_qpsolvers) and importlib.util.find_spec(module) is not None
    ]


def get_solver(name: str, **options: Any) -> QPSolver:
    """Make a solver by name; options go to its constructor.

    Raises:
        UnknownName: no solver has that name.
        SolverNotInstalled: its package is missing.
        OptionError: the solver does not know an option, or not that value.
    """
    if name not in _PACKAGES:
        raise UnknownName("QP solver", name, _PACKAGES)
    module, package = _PACKAGES[name]
    try:
        importlib.import_module(module)
        if name in _NATIVE:
            where, what = _NATIVE[name]
            make = getattr(importlib.import_module(where), what)
        else:
            package = f"qpsolvers {package}"
            adapter = importlib.import_module("rcmqp.qp.qpsolvers_")
            make = partial(adapter.ThroughQpsolvers, name)
    except ImportError as error:
        raise SolverNotInstalled(name, package) from error
    check_options(name, make, options)
    solver: QPSolver = make(**options)
    return solver


def check_options(name: str, make: Callable[..., Any], options: Mapping[str, Any]) -> None:
    """Raise OptionError for options that ``make`` does not take."""
    known = inspect.signature(make).parameters
    takes_any = any(p.kind is p.VAR_KEYWORD for p in known.values())
    if not takes_any and (wrong := sorted(set(options) - set(known))):
        raise OptionError(f"{name} has no option {wrong}; it has {sorted(known)}")
