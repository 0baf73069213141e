"""Tables: labels, files, and other packages' tables."""

import importlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from sweep_points import GRID, odd, same

import hereditary as hd

NAMES = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=4)


@st.composite
def tables(draw):
    axes = {}
    for name in draw(st.lists(NAMES, min_size=1, max_size=3, unique=True)):
        values = st.lists(st.floats(-9, 9) | st.integers(0, 9), min_size=1, max_size=3, unique=True)
        axes[name] = np.array(draw(values))
    shape = tuple(axis.size for axis in axes.values())
    own = st.sampled_from([(), (2,), (1, 2)])
    values = {
        name: draw(hnp.arrays(kind, shape + draw(own)))
        for name, kind in draw(
            st.dictionaries(NAMES, st.sampled_from([float, "U3"]), max_size=3)
        ).items()
    }
    return hd.Table(axes, values, draw(hnp.arrays("U9", shape)))


@given(tables())
def test_files_hold_every_bit(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("table") / "name.without.suffix"
    table.save(path)
    assert path.exists()
    assert same(hd.Table.load(path), table)
    assert same(hd.Table.load(str(path)), table)


@pytest.fixture(scope="module")
def table():
    return hd.sweep(odd, GRID)


def test_labels(table):
    assert table.shape == (4, 3)
    assert table.names == ("extremes", "place")
    assert table["extremes"].shape == (4, 3, 5)
    assert table["place"] is table.values["place"]
    assert table.success.tolist() == (table.status == "completed").tolist()
    assert table.success.sum() == 4
    assert repr(table) == "Table(extremes, place over b (4), c (3); 4 of 12 completed)"
    with pytest.raises(
        KeyError, match="name must be one of 'extremes', 'place', got 'b'; axes are"
    ):
        table["b"]


@pytest.mark.parametrize("write", [lambda p: np.savez(p, x=1), lambda p: np.save(p, np.eye(2))])
def test_other_files_are_refused(tmp_path, write):
    with open(tmp_path / "other", "wb") as file:
        write(file)
    with pytest.raises(ValueError, match=r"path must be a whole file that Table\.save wrote"):
        hd.Table.load(tmp_path / "other")


def test_a_file_cut_or_changed_is_told(table, tmp_path):
    path = tmp_path / "cut"
    table.save(path)
    content = path.read_bytes()
    for n in (0, 10, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:n])
        with pytest.raises(ValueError, match="path must be a whole file"):
            hd.Table.load(path)
    with open(path, "wb") as file:
        np.savez(file, status=table.status, **{"axis:b": GRID["b"]})
    with pytest.raises(ValueError, match="path must be a whole file"):
        hd.Table.load(path)


def test_pandas(table):
    pytest.importorskip("pandas")
    frame = table.to_pandas()
    assert list(frame.index.names) == ["b", "c"]
    assert list(frame.columns) == [*(f"extremes[{k}]" for k in range(5)), "place", "status"]
    assert len(frame) == 12
    assert frame.loc[(GRID["b"][2], 50.0), "extremes[2]"] == table["extremes"][2, 2, 2]
    assert frame["status"].tolist() == table.status.ravel().tolist()
    single = hd.sweep(lambda n: {"m": np.full((1, 2), float(n))}, {"n": [1, 2]}).to_pandas()
    assert single.index.name == "n"
    assert single["m[0, 1]"].tolist() == [1.0, 2.0]


def test_xarray(table):
    pytest.importorskip("xarray")
    data = table.to_xarray()
    assert data["extremes"].dims == ("b", "c", "extremes_0")
    assert dict(data.sizes) == {"b": 4, "c": 3, "extremes_0": 5}
    assert data["place"].sel(b=0.5, c=50.0).item() == table["place"][0, 2]
    assert (data["status"].values == table.status).all()


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_a_missing_package_is_named(table, package, monkeypatch):
    def import_module(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", import_module)
    with pytest.raises(
        ImportError, match=f"to_{package} needs {package}, .* pip install {package}"
    ):
        getattr(table, f"to_{package}")()
