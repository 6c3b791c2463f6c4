"""The house's own laws: floors, import cycles, where the large libraries may be imported, docstrings."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "oed"

HOUSE: dict[str, str] = {
    "foundation": "",
    "kernel": "foundation",
    "uncertainty": "foundation kernel",
    "optimize": "foundation kernel uncertainty",
    "robots": "foundation kernel",
    "equations": "foundation kernel",
    "bounds": "foundation kernel optimize robots",
    "logs": "foundation kernel",
    "estimation": "foundation kernel robots logs",
    "simulation": "foundation kernel optimize robots logs estimation",
    "study": "foundation kernel uncertainty optimize robots equations bounds logs estimation simulation",
    "records": "foundation kernel bounds estimation simulation study",
    "exporters": "foundation kernel robots logs records",
    "workflow": "foundation kernel uncertainty optimize robots equations bounds logs estimation simulation "
    "study records exporters",
    "report": "foundation kernel robots simulation records",
    "cli": "foundation kernel bounds study records workflow exporters report",
}
"""The rooms of the package, from the bottom up, and which others each may import."""

CASADI_ROOMS = (
    "kernel",
    "uncertainty",
    "optimize",
    "robots",
    "equations",
    "bounds",
    "logs",
    "estimation",
    "simulation",
)
FIGURE_MODULES = {
    f"oed.report.{name}"
    for name in (
        "figures.draw",
        "film.stage",
    )
}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, ast.Module]:
    return {module_name(path): ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob("*.py"))}


PACKAGES = {module_name(path) for path in PACKAGE.rglob("__init__.py")}


def every_module(law: Callable[[str], None]) -> Callable[[], None]:
    """One test of a law that all modules keep: hundreds of tests would take longer than the law."""

    def test() -> None:
        broken = []
        for module in modules():
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


@cache
def imported(module: str, *, lazy: bool) -> frozenset[str]:
    """Full names of what a module imports; a submodule by its own name."""
    names: set[str] = set()
    for node in import_nodes(modules()[module], lazy=lazy):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
            continue
        assert node.level == 0, f"{module} imports relatively"
        submodules = {f"{node.module}.{alias.name}" for alias in node.names} & modules().keys()
        names |= submodules
        if len(submodules) < len(node.names):
            names.add(str(node.module))
    return frozenset(names)


def libraries(module: str, *, lazy: bool) -> set[str]:
    return {name.split(".")[0] for name in imported(module, lazy=lazy)}


def test_this_test_sees_imports():
    assert "oed.kernel.dynamics.spline" in imported("oed.kernel.dynamics.trajectory", lazy=False)
    assert "casadi" in libraries("oed.robots.models.model", lazy=False)
    assert "pint" not in libraries("oed.foundation.quantities", lazy=False)
    assert "pint" in libraries("oed.foundation.quantities", lazy=True)


def test_the_top_level_holds_rooms_and_the_public_names():
    found = {path.name for path in PACKAGE.iterdir() if path.name != "__pycache__"}
    assert found == {*HOUSE, "__init__.py", "__init__.pyi", "__main__.py", "py.typed"}


def test_rooms_are_listed_from_the_bottom_up():
    seen: set[str] = set()
    for room, allowed in HOUSE.items():
        assert set(allowed.split()) <= seen
        seen.add(room)


@pytest.mark.slow
@every_module
def test_imports_never_go_up(module: str):
    """Those inside functions neither, nor to rooms that are none of a room's."""
    room = part_of(module)
    allowed = {room, *HOUSE.get(room, " ".join(HOUSE)).split()}
    others = [name for name in imported(module, lazy=True) if name.startswith("oed.")]
    assert not [name for name in others if part_of(name) not in allowed]


@pytest.mark.slow
def test_no_module_imports_itself_in_a_circle():
    graph = {module: imported(module, lazy=True) & modules().keys() - {module} for module in modules()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


@pytest.mark.slow
@every_module
def test_casadi_is_imported_from_the_kernel_to_simulations_only(module: str):
    assert part_of(module) in CASADI_ROOMS or "casadi" not in libraries(module, lazy=True)


@pytest.mark.slow
@every_module
def test_only_messages_and_tables_write_to_the_terminal(module: str):
    calls = (node.func for node in ast.walk(modules()[module]) if isinstance(node, ast.Call))
    names = {func.id for func in calls if isinstance(func, ast.Name)}
    assert module in ("oed.cli.program", "oed.cli.terminal.console") or "print" not in names, (
        "use tell or say of oed.cli.terminal.messages"
    )


@pytest.mark.slow
@every_module
def test_pymoo_is_imported_by_the_genetic_solver_only(module: str):
    assert module == "oed.optimize.genetic" or "pymoo" not in libraries(module, lazy=True)


@pytest.mark.slow
@every_module
def test_matplotlib_is_imported_by_reports_only(module: str):
    if part_of(module) != "report":
        assert "matplotlib" not in libraries(module, lazy=True)
    elif module not in FIGURE_MODULES:
        assert "matplotlib" not in libraries(module, lazy=False)


@pytest.mark.parametrize(
    ("module", "unloaded"),
    [
        ("oed", {"casadi", "matplotlib", "pymoo", "numpy", "inspect", "importlib.abc"}),
        ("oed.cli.program", {"casadi", "matplotlib", "pymoo"}),
        ("oed.study.study", {"matplotlib", "pymoo", "pint", "rich", "scipy.stats", "scipy.interpolate"}),
    ],
)
@pytest.mark.slow
def test_imports_cost_no_more_than_they_must(module: str, unloaded: set[str]):
    code = f"import sys, {module}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert unloaded.isdisjoint(run.stdout.split())


@pytest.mark.slow
def test_a_check_loads_no_library_that_it_does_not_need():
    # Matplotlib, pymoo and so on take longer to load than the check itself.
    study = PACKAGE.parent / "problems" / "choi_skid_steer.yaml"
    code = f"import sys, oed.cli; print(oed.cli.main(['check', {str(study)!r}]), *sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    code, *loaded = run.stdout.splitlines()[-1].split()
    assert code == "0"
    assert "oed.kernel.identifiability" in loaded
    heavy = {"matplotlib", "pymoo", "shapely", "rich", "pint", "distributed", "jinja2", "plotly", "mujoco"}
    parts = {
        f"scipy.{name}" for name in ("stats", "interpolate", "optimize", "integrate", "linalg", "sparse")
    }
    # What SciPy's parts bring along.
    brought = {"numpy.f2py", "numpy.testing", "unittest"}
    # What computes, and what a check of a study without a simulated robot or an earlier record leaves alone.
    own = {"oed.workflow.runner", "oed.report", "oed.estimation.methods.joint", "oed.simulation.trial.run"}
    own |= {"oed.bounds.smallest", "oed.records.record", "oed.records.recorded_study"}
    assert (heavy | parts | brought | own).isdisjoint(loaded)


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
    assert documented(modules()[module]), f"{module} has no docstring"
    assert not list(undocumented(modules()[module].body, module))


def functions(module: str) -> Iterator[ast.FunctionDef]:
    """Public functions of a module, and methods of its classes."""
    for body in (
        modules()[module].body,
        *(c.body for c in modules()[module].body if isinstance(c, ast.ClassDef)),
    ):
        for node in body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield node


def says_arguments(node: ast.FunctionDef) -> bool:
    return "Args:" in (ast.get_docstring(node) or "")


def test_functions_of_three_arguments_say_what_each_is():
    """Or have the name of a method that says it: that of the class they inherit from."""
    said = {node.name for module in modules() for node in functions(module) if says_arguments(node)}
    said |= {"find_spec"}  # Python's own
    silent = [
        f"{module}.{node.name}"
        for module in modules()
        for node in functions(module)
        if node.name not in said
        and len({arg.arg for arg in (*node.args.args, *node.args.kwonlyargs)} - {"self", "cls"}) >= 3
    ]
    assert not silent


@pytest.mark.slow
@every_module
def test_docstrings_stand_alone(module: str):
    starts = ("The same", "Their units", "Likewise", "Ditto")
    nodes = [node for node in ast.walk(modules()[module]) if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    leaning = [node.name for node in nodes if (ast.get_docstring(node) or "").startswith(starts)]
    assert not leaning


@pytest.mark.parametrize("stub", sorted(PACKAGE.rglob("*.pyi")), ids=module_name)
def test_every_public_name_exists(stub: Path):
    package = importlib.import_module(module_name(stub))
    imports = [node for node in ast.parse(stub.read_text()).body if isinstance(node, ast.ImportFrom)]
    listed = [alias.asname for node in imports for alias in node.names]
    assert dir(package) == sorted(set(listed))
    # Of the package itself a star brings the functions.
    assert package.__all__ == [name for name in dir(package) if module_name(stub) != "oed" or name.islower()]
    assert len(listed) == len(set(listed))
    assert all(getattr(package, name) is not None for name in listed)


def test_a_public_name_that_does_not_exist_is_refused():
    import oed

    with pytest.raises(AttributeError, match=r"^module 'oed' has no attribute 'nonsense'$"):
        oed.nonsense  # noqa: B018
    with pytest.raises(AttributeError) as error:
        oed.Problm  # noqa: B018
    # What Python takes its "Did you mean: 'Problem'?" from.
    assert (error.value.name, error.value.obj) == ("Problm", oed)


@pytest.fixture(scope="module")
def kept(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where mypy keeps what it knows of unchanged files, from one run of the tests to the next."""
    cache = getattr(pytestconfig, "cache", None)
    return tmp_path_factory.mktemp("mypy") if cache is None else Path(cache.mkdir("mypy"))


def said_by_mypy(kept: Path, user: Path, *options: str) -> str:
    """What a user is told who has none of this project's settings."""
    pytest.importorskip("mypy")
    settings = ("--strict", "--config-file=", f"--cache-dir={kept}")
    command = [sys.executable, "-m", "mypy", *settings, *options, str(user)]
    return subprocess.run(command, capture_output=True, text=True, cwd=PACKAGE.parent).stdout


@pytest.mark.slow
def test_type_checkers_know_the_public_names(tmp_path: Path, kept: Path):
    user = tmp_path / "user.py"
    user.write_text("from oed import Problem, nonsense, lazy_loader\n")
    output = said_by_mypy(kept, user, "--follow-imports=skip", str(PACKAGE / "__init__.pyi"))
    assert output.count("error:") == 2, output
    assert 'Module "oed" has no attribute "nonsense"' in output
    assert 'Module "oed" has no attribute "lazy_loader"' in output


TAKEN = """\
import oed

problem = oed.Problem(
    model=oed.DifferentialDrive(wheel_radius="4.9 cm", track=0.18),
    design=oed.DesignSpace(duration="20 s", spline={"coefficients": 10}, start={"x": 0, "heading": "10 deg"}),
    measurement=[oed.Poses(noise={"position": "1 cm", "heading": "1 deg"}), oed.YawRate(noise="1 deg/s")],
    limits=[oed.WheelSpeed(bounds=10), oed.Rectangle(x=(-1, 1), y=["-1 m", 1])],
    criterion="E",
    estimate=["track"],
)
options = oed.Ipopt(starts=2, perturbations=0, time_limit="10 s")
track: float = options.tolerance
"""


@pytest.mark.slow
def test_type_checkers_take_what_is_taken_when_it_runs(tmp_path: Path, kept: Path):
    exec(compile(TAKEN, "user.py", "exec"), {})
    user = tmp_path / "user.py"
    user.write_text(f"{TAKEN}wrong: str = options.tolerance\noed.Problem(model=1)\n")
    output = said_by_mypy(kept, user, "--follow-imports=silent")
    lines = [line for line in output.splitlines() if "error:" in line]
    last = user.read_text().count("\n")
    assert {int(line.split(":")[1]) for line in lines} == {last - 1, last}, output
