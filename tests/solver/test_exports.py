"""Solutions in files and as tables of other packages."""

import pickle
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

import hereditary as hd

pytestmark = pytest.mark.core


@pytest.fixture(params=["order above 1", "complex", "events"])
def solution(request):
    if request.param == "complex":
        equation = hd.Equation(hd.Caputo(0.8), lambda t, z: 1j * z, 1 + 0j)
        return hd.solve(equation, 1.0, 50)
    if request.param == "events":
        equation, half = hd.scenes.relaxation(0.6), lambda t, y: y[0] - 0.5
        return hd.solve(equation, 3.0, rtol=1e-6, events=half)
    return hd.solve(hd.scenes.stick_slip(), 1.0, 50)


def test_a_file_gives_back_a_solution_but_for_its_dense_output(solution, tmp_path):
    solution.save(tmp_path / "kept")
    found = hd.Solution.load(tmp_path / "kept")
    for name in ("t", "y", "ydot"):
        rows, kept = getattr(found, name), getattr(solution, name)
        assert np.array_equal(rows, kept, equal_nan=True) if kept is not None else rows is None
    assert found.y.dtype == solution.y.dtype
    assert found.status is solution.status
    assert found.message == solution.message
    lists = {"jumps"} & solution.stats.keys()
    assert all(found.stats.pop(name) == solution.stats.pop(name) for name in lists)
    assert found.stats == pytest.approx(solution.stats)
    for name in ("t_events", "y_events"):
        for values, kept in zip(getattr(found, name), getattr(solution, name), strict=True):
            assert np.array_equal(values, kept)
    state, kept = found.state, solution.state
    assert np.array_equal(state.y, kept.y)
    for name in ("t", "identity", "event_signs"):
        assert getattr(state, name) == getattr(kept, name)
    with pytest.raises(ValueError, match="kept no dense output"):
        found(0.5)


@pytest.mark.parametrize("damage", ["foreign", "another archive", "cut"])
def test_other_files_are_refused(damage, tmp_path):
    path = tmp_path / "kept"
    hd.solve(hd.scenes.relaxation(0.6), 1.0, 50).save(path)
    if damage == "foreign":
        path.write_text("t, y")
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:200])
    else:
        with open(path, "wb") as file:
            np.savez(file, x=np.zeros(3))
    with pytest.raises(ValueError, match=r"a solution that Solution\.save wrote"):
        hd.Solution.load(path)
    with pytest.raises(FileNotFoundError):
        hd.Solution.load(tmp_path / "nothing")


def changed(path, old, new):
    """Replace words in the text of a file."""
    with np.load(path) as loaded:
        arrays = {name: loaded[name] for name in loaded.files}
    assert old in str(arrays["text"])
    arrays["text"] = np.array(str(arrays["text"]).replace(old, new))
    with open(path, "wb") as file:
        np.savez(file, **arrays)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"version": "', '"version": "9.', "resume must come from the same version"),
        ("hereditary.given.steps.UniformSteps", "builtins.eval", "resume must be of classes that"),
    ],
)
def test_states_of_other_versions_and_classes_are_refused(old, new, words, tmp_path):
    path = tmp_path / "kept"
    sol = hd.solve(hd.scenes.relaxation(0.6), 1.0, 50)
    sol.save(path)
    changed(path, old, new)
    found = hd.Solution.load(path)
    assert np.array_equal(found.y, sol.y)
    with pytest.raises(ValueError, match=words):
        found.state  # noqa: B018


class Opens:
    def __reduce__(self):
        return pytest.fail, ("code of a file was run",)


def test_no_code_of_a_file_is_run(tmp_path):
    with open(tmp_path / "kept", "wb") as file:
        np.savez(file, t=np.array([Opens()], dtype=object), text=np.array("{}"))
    with pytest.raises(ValueError, match=r"a solution that Solution\.save wrote"):
        hd.Solution.load(tmp_path / "kept")


@dataclass(frozen=True)
class Note:
    size: float = 1.0


def test_a_history_that_holds_other_objects_has_rows_alone_in_a_file(tmp_path):
    history = hd.Direct()
    object.__setattr__(history, "note", Note())
    sol = hd.solve(hd.scenes.relaxation(0.6), 1.0, 50, history=history)
    with pytest.warns(UserWarning, match=r"no state: state\.history\.note is a .*Note"):
        sol.save(tmp_path / "kept")
    found = hd.Solution.load(tmp_path / "kept")
    assert np.array_equal(found.y, sol.y)
    found.save(tmp_path / "again")
    for each in (found, pickle.loads(pickle.dumps(found)), hd.Solution.load(tmp_path / "again")):
        with pytest.raises(ValueError, match="have a state to resume, got one from a file without"):
            hd.solve(hd.scenes.relaxation(0.6), 2.0, resume=each.state)


def test_tables_of_other_packages(solution):
    pytest.importorskip("pandas")
    frame = solution.to_pandas()
    assert frame.index.name == "t"
    assert np.array_equal(frame.index, solution.t)
    assert np.array_equal(frame["y[0]"], solution.y[:, 0])
    assert ("ydot[0]" in frame) == (solution.ydot is not None)
    pytest.importorskip("xarray")
    data = solution.to_xarray()
    assert np.array_equal(data.y, solution.y)
    assert data.y.dims == ("t", "component")
    assert data.attrs["status"] == solution.status
    assert data.attrs["n_steps"] == solution.stats["n_steps"]


@pytest.mark.parametrize("solve", [hd.solve, partial(hd.ensemble, params=[[10, 28, 8 / 3]] * 2)])
def test_chosen_components_keep_their_numbers(solve, tmp_path):
    pytest.importorskip("xarray")
    found = solve(hd.scenes.lorenz(), 0.1, n_steps=10, components=[2, 0])
    found.save(tmp_path / "kept")
    for each in (found, type(found).load(tmp_path / "kept")):
        assert list(each.to_pandas()) == ["y[2]", "y[0]"]
        assert each.to_xarray().component.values.tolist() == [2, 0]
        assert np.array_equal(each.to_xarray().y.sel(component=0), each.y[..., 1])


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_a_package_that_is_not_there_is_named(package, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr("importlib.import_module", missing)
    words = f"to_{package} needs {package}, .* pip install {package}"
    for made in (hd.solve(hd.scenes.relaxation(0.6), 1.0, 10), hd.sweep(lambda a: a, {"a": [1.0]})):
        with pytest.raises(ImportError, match=words):
            getattr(made, f"to_{package}")()
