"""The house's own laws: floors, import cycles, where the large libraries may be imported, docstrings."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "oed"

FLOORS: tuple[set[str], ...] = (
    {
        "spline",
        "quantities",
        "component",
        "expression",
        "errors",
        "files",
        "folders",
        "locks",
        "signals",
        "extras",
        "lazy",
        "names",
        "shown",
    },
    {"models"},
    {"logs"},
    {"trajectory", "rollout", "matrices", "square_root", "intervals", "enclosures", "direct_call"},
    {"measurements"},
    {"limits", "information", "prior", "uncertainty", "robust", "regressors", "readings", "segments"},
    {"criteria"},
    {"problem"},
    {"between", "finiteness", "coarser"},
    {"evaluation", "problem_tables"},
    {"departures", "solution", "identifiability"},
    {"solvers", "baselines", "bounds"},
    {"estimators"},
    {"validation", "calibration"},
    {"trial"},
    {
        "study",
        "presets",
        "starter",
        "study_errors",
        "yaml_source",
        "record",
        "path_file",
        "runner",
        "saving",
        "robustness",
        "experiments",
        "calibration_record",
        "stored",
        "recorded_study",
        "estimation",
        "driven",
        "next_drive",
        "sweep",
    },
    {"exporters"},
    {"report"},
    {"physics_film"},
    {"cli", "commands", "console", "messages", "streams", "__init__", "__main__"},
)
"""Files and folders of the package, each importing only from its own floor and those above it here."""

FLOOR = {part: level for level, parts in enumerate(FLOORS) for part in parts}
CASADI_FLOORS = range(FLOOR["models"], FLOOR["solvers"] + 1)
FIGURE_MODULES = {
    f"oed.report.{name}"
    for name in (
        "figures",
        "panels",
        "path_figures",
        "path_panels",
        "stage",
        "sweep_figures",
        "trial_panels",
        "estimate.figures",
    )
}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob("*.py"))}
PACKAGES = {module_name(path) for path in PACKAGE.rglob("__init__.py")}


def every_module(law: Callable[[str], None]) -> Callable[[], None]:
    """One test of a law that all modules keep: hundreds of tests would take longer than the law."""

    def test() -> None:
        broken = []
        for module in MODULES:
            try:
                law(module)
            except AssertionError as error:
                broken.append(f"{module}: {error}")
        assert not broken, "\n".join(broken)

    test.__doc__ = law.__doc__
    return test


def part_of(module: str) -> str:
    """The top-level file or folder of the package that a module belongs to."""
    return module.split(".")[1] if "." in module else "__init__"


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def import_nodes(tree: ast.AST, *, lazy: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports that run; those inside functions only if `lazy`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif is_type_checking(node):
            for other in node.orelse:
                yield from import_nodes(ast.Module([other], []), lazy=lazy)
        elif lazy or not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from import_nodes(node, lazy=lazy)


def imported(module: str, *, lazy: bool) -> set[str]:
    """Full names of what a module imports; a submodule by its own name."""
    names: set[str] = set()
    for node in import_nodes(MODULES[module], lazy=lazy):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
            continue
        assert node.level == 0, f"{module} imports relatively"
        submodules = {f"{node.module}.{alias.name}" for alias in node.names} & MODULES.keys()
        names |= submodules
        if len(submodules) < len(node.names):
            names.add(str(node.module))
    return names


def libraries(module: str, *, lazy: bool) -> set[str]:
    return {name.split(".")[0] for name in imported(module, lazy=lazy)}


def test_this_test_sees_imports():
    assert "oed.spline" in imported("oed.trajectory", lazy=False)
    assert "casadi" in libraries("oed.models.model", lazy=False)
    assert "pint" not in libraries("oed.quantities", lazy=False)
    assert "pint" in libraries("oed.quantities", lazy=True)


@every_module
def test_every_part_has_a_floor(module: str):
    part = part_of(module)
    assert part in FLOOR, f"oed/{part} is new: add it to FLOORS in {Path(__file__).name}"


@every_module
def test_imports_never_go_up(module: str):
    level = FLOOR.get(part_of(module), len(FLOORS))
    for name in imported(module, lazy=True):
        if name.split(".")[0] == "oed":
            assert FLOOR.get(part_of(name), 0) <= level, f"{module} imports {name}, which lies above it"


def test_no_module_imports_itself_in_a_circle():
    graph = {module: imported(module, lazy=False) & MODULES.keys() - {module} for module in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


@every_module
def test_casadi_is_imported_from_models_to_solvers_only(module: str):
    allowed = FLOOR.get(part_of(module)) in CASADI_FLOORS
    assert allowed or "casadi" not in libraries(module, lazy=True)


@every_module
def test_only_messages_and_tables_write_to_the_terminal(module: str):
    calls = (node.func for node in ast.walk(MODULES[module]) if isinstance(node, ast.Call))
    names = {func.id for func in calls if isinstance(func, ast.Name)}
    assert module in ("oed.cli", "oed.console") or "print" not in names, "use oed.messages.tell or say"


@every_module
def test_pymoo_is_imported_by_the_genetic_solver_only(module: str):
    assert module == "oed.solvers.genetic" or "pymoo" not in libraries(module, lazy=True)


@every_module
def test_matplotlib_is_imported_by_reports_only(module: str):
    if part_of(module) != "report":
        assert "matplotlib" not in libraries(module, lazy=True)
    elif module not in FIGURE_MODULES:
        assert "matplotlib" not in libraries(module, lazy=False)


@pytest.mark.parametrize(
    ("module", "unloaded"),
    [
        ("oed", {"casadi", "matplotlib", "pymoo", "numpy"}),
        ("oed.cli", {"casadi", "matplotlib", "pymoo"}),
        ("oed.study", {"matplotlib", "pymoo", "pint", "rich", "scipy.stats", "scipy.interpolate"}),
    ],
)
@pytest.mark.slow
def test_imports_cost_no_more_than_they_must(module: str, unloaded: set[str]):
    code = f"import sys, {module}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert unloaded.isdisjoint(run.stdout.split())


def test_a_check_loads_no_library_that_it_does_not_need():
    # Matplotlib, pymoo and so on take longer to load than the check itself.
    study = PACKAGE.parent / "problems" / "choi_skid_steer.yaml"
    code = f"import sys, oed.cli; print(oed.cli.main(['check', {str(study)!r}]), *sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    code, *loaded = run.stdout.splitlines()[-1].split()
    assert code == "0"
    assert "oed.identifiability" in loaded
    heavy = {"matplotlib", "pymoo", "shapely", "rich", "pint", "distributed", "jinja2", "plotly"}
    parts = {f"scipy.{name}" for name in ("stats", "interpolate", "optimize", "integrate", "linalg")}
    # What computes, and what a check of a study without a simulated robot leaves alone.
    own = {"oed.runner", "oed.report", "oed.calibration.joint", "oed.trial.run"}
    assert (heavy | parts | own).isdisjoint(loaded)


def documented(node: ast.AST) -> bool:
    return bool((ast.get_docstring(node) or "").strip())


def undocumented(body: list[ast.stmt], prefix: str) -> Iterator[str]:
    """Public classes, functions and methods without a docstring."""
    for node in body:
        if not isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if node.name.startswith("_"):
            continue
        if not documented(node):
            yield f"{prefix}.{node.name}"
        if isinstance(node, ast.ClassDef):
            yield from undocumented(node.body, f"{prefix}.{node.name}")


@every_module
def test_every_public_name_is_documented(module: str):
    assert documented(MODULES[module]), f"{module} has no docstring"
    assert not list(undocumented(MODULES[module].body, module))


def test_every_public_name_of_the_package_exists():
    import oed

    assert sorted(oed.__all__) == sorted(set(oed.__all__))
    for name in oed.__all__:
        assert getattr(oed, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        oed.nonsense  # noqa: B018
