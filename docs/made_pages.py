"""Pages of the site that are made: the reference, the studies, the picture of the imports."""

import ast
import pathlib
import shutil
import tomllib

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

import hereditary

# Scripts of the gallery, the most interesting first; others follow.
GALLERY = (
    "block_on_its_spring",
    "stick_slip",
    "strange_attractor",
    "viscoelastic_beam",
    "viscoelastic_models",
    "subdiffusion",
    "epidemic",
    "resonance",
    "lorenz_with_memory",
    "neuron",
    "late_population",
    "bifurcation_diagram",
    "map_of_regimes",
    "models_of_the_field",
    "control_loop",
    "chain_of_blocks",
    "measured_kernel",
    "order_that_varies",
    "volterra",
    "own_scheme",
)


# Public names by task, as the reference lists them; names that are not here follow.
TASKS = {
    "State an equation": "Equation Caputo RiemannLiouville Memory Delay",
    "Solve it": "solve Solution Status solve_ivp derivative exact",
    "Schemes": "Collocation ExplicitCaputo BDF L1 L2 L12 L2Sigma Adams ProductTrapezoid"
    " GrunwaldLetnikov IMEX graded Graded",
    "Histories": "SumOfExponentials FFT Direct",
    "Memory kernels": "PowerLaw TemperedPowerLaw GammaDensity LognormalDensity WeibullDensity"
    " MittagLeffler StretchedExponential DistributedOrder Prony Kernel TabulatedKernel MemoryKernel"
    " fit_exponentials ExponentialSum",
    "Memory of large systems": "memory_term MemoryTerm",
    "Many runs": "ensemble Ensemble sweep Table",
    "Fit data": "fit FitResult Estimates sensitivities Sensitivities",
    "Frequencies": "frequency_response FrequencyResponse power_spectrum PowerSpectrum",
    "Chaos": "lyapunov LyapunovResult zero_one_test ZeroOneResult maxima stroboscopic Section"
    " classify Regime RegimeVerdict",
    "Errors": "Accuracy convergence_table ConvergenceTable",
    "Models and figures": "scenes plots",
    "Warnings": "SolveWarning StabilityWarning PythonFunctionWarning KernelWarning"
    " IdentifiabilityWarning",
}


def by_interest(name):
    """Return the place of a script in the gallery, by its file name."""
    stem = pathlib.Path(name).stem
    return GALLERY.index(stem) if stem in GALLERY else len(GALLERY)


def styled(gallery_conf, name):
    """Give figures of the gallery the style of the package."""
    plt.style.use(hereditary.plots.STYLE)


def make(docs):
    """Write all made pages below ``docs/made``; a page that is the same is left alone.

    Parameters
    ----------
    docs : pathlib.Path
    """
    made = docs / "made"
    shutil.rmtree(made / "scripts", ignore_errors=True)
    shutil.copytree(docs / "gallery", made / "scripts")
    written = {made / "api.md": reference()}
    written |= studies(made / "studies", docs.parent / "convergence")
    for path, text in written.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text() != text:
            path.write_text(text)
    for stale in set((made / "studies").glob("*.md")) - written.keys():
        stale.unlink()
    level = floors(docs.parent / "pyproject.toml")
    imports_figure(made / "imports.png", docs.parent / "src" / "hereditary", level)


def reference():
    """Return the page that lists every public name."""
    groups = {title: names.split() for title, names in TASKS.items()}
    left = set(hereditary.__all__).difference(*groups.values())
    if left:
        groups["More"] = sorted(left)
    page = "# Reference\n\nEvery public name by task, from `import hereditary as hd`. "
    page += "Begin with {py:obj}`hereditary.Equation` and {py:obj}`hereditary.solve`.\n"
    for title, names in groups.items():
        page += f"\n## {title}\n\n```{{eval-rst}}\n.. currentmodule:: hereditary\n\n"
        page += ".. autosummary::\n   :toctree: api\n\n"
        page += "".join(f"   {name}\n" for name in names) + "```\n"
    return page


def studies(folder, scripts):
    """Return the pages of studies by their paths: claim, figure, and files."""
    pages, titles = {}, {}
    for script in sorted(scripts.glob("[!_]*.py")):
        title, _, rest = ast.get_docstring(ast.parse(script.read_text())).partition("\n")
        titles[script.stem] = title
        page = f"# {script.stem}\n\n{title}\n{rest}\n\n"
        results = scripts / "results"
        figures = sorted(
            {*results.glob(f"{script.stem}.png"), *results.glob(f"{script.stem}_*.png")}
        )
        for figure in figures:
            page += f"![{script.stem}](../../../convergence/results/{figure.name})\n\n"
        files = [f"[{script.name}](../../../convergence/{script.name})"]
        if (results / f"{script.stem}.csv").exists():
            files.append(f"[{script.stem}.csv](../../../convergence/results/{script.stem}.csv)")
        page += f"Files: {', '.join(files)}. Run it with `python convergence/{script.name}`; "
        pages[folder / f"{script.stem}.md"] = page + "`--quick` is a smoke test at small sizes.\n"
    index = "# Studies\n\nThese scripts measure what the pages say about accuracy and speed. "
    index += "A script fails if its claim does not hold. Each CSV names the machine and the day of "
    index += "its timings.\n\n"
    index += "".join(f"- [{name}]({name}.md): {title}\n" for name, title in titles.items())
    index += "\n```{toctree}\n:hidden:\n\n" + "\n".join(titles) + "\n```\n"
    pages[folder / "index.md"] = index
    return pages


def floors(project):
    """Return the floor of each room, as the contract of the imports has it."""
    contract = tomllib.loads(project.read_text())["tool"]["importlinter"]["contracts"][0]
    layers = enumerate(reversed(contract["layers"]))
    return {room: height for height, layer in layers for room in layer.split(" | ")}


def imports_of(source, level):
    """Return for each box the lower boxes that it imports, and the floor of each."""
    found, floor = {}, {}
    for path in source.rglob("*.py"):
        module = (*path.relative_to(source).parts[:-1], path.stem)
        if module[0] in ("__init__", "__main__"):
            continue
        own = module[0]
        found.setdefault(own, set())
        floor[own] = max(floor.get(own, 0), level[module[0]])
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.ImportFrom) or not node.level:
                continue
            above = list(module[: len(module) - node.level])
            names = above + (node.module.split(".") if node.module else [])
            targets = [names] if node.module else [[*names, alias.name] for alias in node.names]
            found[own] |= {target[0] for target in targets} - {own}
    used = sorted(set(floor.values()))
    found = {box: {o for o in others if floor[o] < floor[box]} for box, others in found.items()}
    return found, {box: used.index(height) for box, height in floor.items()}


def imports_figure(path, source, level):
    """Draw rooms on their floors, with an arrow for each that imports one of a lower floor."""
    imports, floor = imports_of(source, level)
    width, place = 10.0, {}
    for height in range(min(floor.values()), max(floor.values()) + 1):
        here = sorted(box for box, own in floor.items() if own == height)
        for k, box in enumerate(here):
            shift = 0.4 * (height % 2) - 0.2
            place[box] = (width * (k + 0.5) / len(here) + shift, height + 0.26 * (k % 3) - 0.26)
    figure, ax = plt.subplots(figsize=(12, 8))
    for box, others in imports.items():
        for other in others:
            if not _by_way(box, other, imports):
                line = {"arrowstyle": "-|>", "color": "0.65", "lw": 0.7, "shrinkA": 8, "shrinkB": 8}
                ax.annotate("", place[other], place[box], arrowprops=line)
    for box, (x, y) in place.items():
        frame = {"boxstyle": "round", "fc": "#dbe9f6", "ec": "#1f4e79"}
        ax.text(x, y, box, ha="center", va="center", fontsize=8, bbox=frame)
    ax.set(xlim=(-0.4, width + 0.4), ylim=(-0.6, max(floor.values()) + 0.7))
    ax.set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def _by_way(box, other, imports):
    """Return whether another import of a box leads to `other` as well, whose arrow is enough."""
    return any(other in imports[via] for via in imports[box] - {other, box})


if __name__ == "__main__":
    make(pathlib.Path(__file__).parent)
