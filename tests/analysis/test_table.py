"""Tables: labels, and other packages' tables."""

import importlib

import numpy as np
import pytest
from sweep_points import GRID, odd

import hereditary as hd


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
