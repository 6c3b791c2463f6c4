"""Stands in for the `ipopt` executable that Pyomo calls, where there is none: CasADi reads the .nl file and
calls the same Ipopt library.

It does what the executable does: `ipopt FILE.nl -AMPL OPTION=VALUE ...` writes FILE.sol. The time that
it needs besides Ipopt's own, which the executable would not, is added to the file named by OED_IPOPT_WASTE.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

_BEGAN = time.perf_counter()

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402

CODES = {
    "Solve_Succeeded": 0,
    "Solved_To_Acceptable_Level": 1,
    "Infeasible_Problem_Detected": 200,
    "Maximum_Iterations_Exceeded": 400,
    "Search_Direction_Becomes_Too_Small": 502,
}
"""solve_result_num by Ipopt's return status; 500 for all others, as the executable reports failures."""
UNKNOWN_TO_THE_LIBRARY = ("halt_on_ampl_error", "option_file_name")


def main(arguments: list[str]) -> int:
    """Solve one file, or say the version."""
    if "-v" in arguments:
        print("Ipopt 3.14.19 (by CasADi)")
        return 0
    file = Path(arguments[0]).with_suffix(".nl")
    problem = ca.NlpBuilder()
    problem.import_nl(str(file))
    x, g = ca.vertcat(*problem.x), ca.vertcat(*problem.g)
    terms = ca.Function("terms", [x], [problem.f, g]).expand()
    unknowns = ca.SX.sym("x", x.shape[0])
    objective, constraints = terms(unknowns)
    solver = ca.nlpsol(
        "ipopt", "ipopt", {"x": unknowns, "f": objective, "g": constraints}, _options(arguments[1:])
    )
    began = time.perf_counter()
    result = solver(x0=problem.x_init, lbx=problem.x_lb, ubx=problem.x_ub, lbg=problem.g_lb, ubg=problem.g_ub)
    inside = time.perf_counter() - began
    status = solver.stats()["return_status"]
    _write(file.with_suffix(".sol"), status, np.array(result["lam_g"]).ravel(), np.array(result["x"]).ravel())
    log = os.environ.get("OED_IPOPT_WASTE")
    if log:
        with Path(log).open("a") as lines:
            lines.write(f"{time.perf_counter() - _BEGAN - inside}\n")
    return 0


def _options(arguments: list[str]) -> dict[str, Any]:
    options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt.print_level": 0}
    for argument in arguments:
        name, _, text = argument.partition("=")
        if text and name not in UNKNOWN_TO_THE_LIBRARY:
            options[f"ipopt.{name}"] = _number(text)
    return options


def _number(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _write(file: Path, status: str, multipliers: np.ndarray, values: np.ndarray) -> None:
    counts = [len(multipliers), len(multipliers), len(values), len(values)]
    numbers = [repr(float(one)) for one in (*multipliers, *values)]
    head = [f"Ipopt by CasADi: {status}", "", "Options", "3", "1", "1", "0", *map(str, counts)]
    file.write_text("\n".join([*head, *numbers, f"objno 0 {CODES.get(status, 500)}", ""]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
