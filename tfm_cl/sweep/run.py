"""The sweep: compares maps of many settings with the dual march of the same steps and a converged one.

A sweep fills a folder::

    sweep.jsonl, sweep.csv        one row for each scene and map setting (`SweepRow`)
    images/KEY.npy                each rendered image; for a dual march also its seconds, KEY.json
    curves/KEY.json               transmittance along one ray, exact and from every map
    (`tfm_cl.sweep.curves`)

and writes a report on these, see `tfm_cl.sweep.written`.

Rows are appended as they are made, so an interrupted sweep continues where it stopped: a row whose key (a
hash of the scene's contents, settings, device and version of tfm_cl) already exists is not made again.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import InputError
from tfm_cl.extras import missing
from tfm_cl.jobs.cluster import Cluster
from tfm_cl.jobs.here import Here
from tfm_cl.jobs.job import Job, Pool, Progress
from tfm_cl.jobs.processes import MOST_JOBS, Processes
from tfm_cl.scene.settings import MAX_STEPS, MapSettings
from tfm_cl.sweep import curves as sweep_curves
from tfm_cl.sweep import written as sweep_report
from tfm_cl.sweep.axes import Axes
from tfm_cl.sweep.keys import content_hash
from tfm_cl.sweep.report.figures import FORMATS
from tfm_cl.sweep.rows import (
    BUDGETS,
    SweepFolder,
    SweepRow,
    Weighting,
    equal_bytes,
    kept_image,
    read_rows,
)
from tfm_cl.sweep.work import OVERHEAD, Overrides, Plan, Task, Workshop

if TYPE_CHECKING:
    from tfm_cl.sweep.curves import Curve, Ray
    from tfm_cl.sweep.renderer import Renderer

__all__ = [
    "BUDGETS",
    "SweepFolder",
    "SweepRow",
    "Weighting",
    "content_hash",
    "equal_bytes",
    "kept_image",
    "read_rows",
    "run",
]


def run(
    inputs: Sequence[Path],
    out: Path,
    renderer: Renderer | Callable[[], Renderer],
    *,
    bases: Sequence[str] = ("dct", "auto"),
    coeffs: Sequence[int] = (2, 4, 8, 16),
    density_weightings: Sequence[Weighting] = (1.0, 10.0),
    ranges: Sequence[str] = (),
    fits: Sequence[str] = (),
    lookups: Sequence[str] = (),
    storages: Sequence[str] = (),
    map_sizes: Sequence[int] = (),
    converged: bool = True,
    converged_steps: int | None = None,
    ray: Ray | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    latex: bool = False,
    figures: Collection[str] = (),
    overrides: Overrides | None = None,
    frame: float | None = None,
    progress: Progress | None = None,
    notice: Callable[[str], None] | None = None,
) -> list[SweepRow]:
    """Sweep scenes over map settings, and write the report.

    Parameters
    ----------
    inputs
        Scene files or volumes.
    out
        Folder of the results, created if missing. Only one sweep at a time may write to it; later sweeps,
        also with other settings, may add to it.
    renderer
        A renderer to use (with one process), or a function that makes one, which other processes can have:
        ``tfm.Renderer`` itself, or ``functools.partial(tfm.Renderer, "gpu")``.
    bases, coeffs, density_weightings, ranges, fits, lookups, storages, map_sizes
        Values of the map's basis, coeffs, density_weighting (α: 1 or more, or ``"auto"``), range, fit,
        lookup, storage and res. Every combination is rendered, except those that a basis refuses. A number of
        coefficients that a basis does not support is replaced by the nearest one that it supports. α only
        matters if a map's target is the transmittance. For the last five, an empty list means the scene's
        own value. A look-up ``"auto"`` is that of the basis, never a lattice.
    converged
        Whether to compare with a converged dual march as well.
    converged_steps
        Steps of both its marches; by default four times those of the scene, at most 1000.
    ray
        Position (u, v) on the first light's map, 0 to 1, of the ray whose curves are kept; by default chosen
        by `tfm_cl.sweep.curves.choose_ray`, once for each reference.
    jobs
        Number of processes. Several of them share the device, so that their times are longer.
    scheduler
        Address of a Dask scheduler, ``tcp://host:8786``, whose workers do the work in place of processes of
        this machine: they see the inputs and ``out`` under the same names, and have devices of one kind.
    latex
        Whether to write ``sweep.tex``, tables for a paper.
    figures
        Formats, ``svg`` or ``pdf``, in which to draw quality against bytes, and the ray, in ``figures``.
    overrides
        Settings for every scene: pairs of a scene file's key and a value, as ``("camera.res", [320, 180])``
        (applied before camera and light are placed), or a function of the scene that was read.
    frame
        Of scenes that change from frame to frame; None: they do not.
    progress
        Called as ``progress(stage, fraction)`` with the fraction done of the work that was left to do.
    notice
        Called with one line on each omission, on each replaced number of coefficients, and on light that no
        lattice can hold.

    Returns
    -------
    list of SweepRow
        All requested rows, made now or earlier, ordered by input, basis, range, fit, lookup, storage, map
        size, α and coefficients.

    Raises
    ------
    InputError
        There is nothing to sweep, a package that it needs is missing, a value or an input cannot be used, a
        reference shows nothing, or the folder cannot be written or holds rows of another kind. Values and
        inputs are checked before anything is rendered.
    DeviceError
        From the renderer, or if a process ended by itself. Rows made before an error are kept.
    """
    if not inputs:
        raise InputError("a sweep needs at least one input")
    lack = missing("sweep")
    if lack:
        raise InputError(f"a sweep {lack}")
    axes = Axes(
        bases=tuple(bases),
        coeffs=tuple(coeffs),
        density_weightings=tuple(density_weightings),
        ranges=tuple(ranges),
        fits=tuple(fits),
        lookups=tuple(lookups),
        storages=tuple(storages),
        map_sizes=tuple(map_sizes),
    )
    _check(converged_steps, ray, jobs, renderer, scheduler)
    _check_figures(figures)
    task = Task(
        out=out,
        axes=axes,
        overrides=overrides if callable(overrides) else tuple(overrides or ()),
        converged=converged,
        converged_steps=converged_steps,
        frame=frame,
    )
    workshop = Workshop(task, renderer)
    pool: Pool
    if scheduler is not None:
        pool = Cluster(scheduler, workshop.worker)
    else:
        pool = Here(workshop.using()) if jobs == 1 else Processes(workshop.worker, jobs)
    sweep = _Sweep(out, ray, notice or _say_nothing, progress, "" if frame is None else f" frame {frame:g}")
    try:
        with pool:
            rows = sweep.run(pool, list(dict.fromkeys(inputs)))
        sweep_report.write(out, latex=latex, figures=figures)
    finally:
        sweep.close()  # after the last process has stopped writing
    return rows


def _check(
    converged_steps: int | None,
    ray: Ray | None,
    jobs: int,
    renderer: Renderer | Callable[[], Renderer],
    scheduler: str | None,
) -> None:
    if converged_steps is not None and not 1 <= converged_steps <= MAX_STEPS:
        raise InputError(f"converged steps = {converged_steps}: should be from 1 to {MAX_STEPS}")
    if ray is not None and not all(0 <= part <= 1 for part in ray):
        raise InputError(f"ray = {ray[0]:g},{ray[1]:g}: should be u,v on the light's map, each from 0 to 1")
    if not 1 <= jobs <= MOST_JOBS:
        raise InputError(f"jobs = {jobs}: should be from 1 to {MOST_JOBS}")
    if jobs > 1 and not callable(renderer):
        raise InputError(f"jobs = {jobs}: every process has its own renderer; give a function that makes one")
    if scheduler is not None and jobs > 1:
        raise InputError(f"jobs = {jobs}: the workers of {scheduler} do the work; leave jobs out")
    if scheduler is not None and not callable(renderer):
        raise InputError(
            f"scheduler = {scheduler}: every worker has its own renderer; give a function that makes one"
        )


def _check_figures(figures: Collection[str]) -> None:
    for form in figures:
        if form not in FORMATS:
            raise InputError(f"figures = {form!r}: should be of {' or '.join(FORMATS)}")
    if figures and (lack := missing("figures")):
        raise InputError(f"drawing figures {lack}")


class _Sweep:
    """Runs the inputs of one sweep through a pool."""

    def __init__(
        self,
        out: Path,
        ray: Ray | None,
        notice: Callable[[str], None],
        progress: Progress | None,
        suffix: str,
    ) -> None:
        self._out, self._ray, self._notice, self._progress = out, ray, notice, progress
        self._suffix = suffix
        """Of the names of inputs: which frame of them it is."""
        self._folder: SweepFolder | None = None

    def run(self, pool: Pool, inputs: list[Path]) -> list[SweepRow]:
        """Make the missing rows and curves of all inputs; returns the rows."""
        plans = self._plans(pool, inputs)
        for line in dict.fromkeys(line for plan in plans for line in plan.notices):
            self._notice(line)
        folder = self._folder = SweepFolder(self._out)
        subjects: dict[str, _Subject] = {}
        for plan in plans:
            if plan.reference not in subjects:
                subjects[plan.reference] = _Subject(folder, self._out, plan.reference, self._ray)
            subjects[plan.reference].add(plan)
        jobs = [job for subject in subjects.values() for job in subject.begin()]
        steps = _Steps(self._progress, sum(subject.weight for subject in subjects.values()))
        try:
            pool.run(jobs, steps)
        except BaseException:
            with contextlib.suppress(InputError):  # the first error counts
                for subject in subjects.values():
                    subject.write_curves()
            raise
        for subject in subjects.values():
            subject.write_curves()
        steps.end()
        return [folder.rows[key] for plan in plans for key in plan.variants]

    def close(self) -> None:
        """Release the folder, after removing the remains of terminated processes."""
        if self._folder is not None:
            self._folder.close()

    def _plans(self, pool: Pool, inputs: list[Path]) -> list[Plan]:
        found: dict[Path, Plan] = {}

        def planned(job: Job, plan: Plan) -> list[Job]:
            found[job.arguments[0]] = plan
            return []

        jobs = [
            Job("plan", (path, name + self._suffix), name, 0.0, planned)
            for path, name in zip(inputs, _names(inputs), strict=True)
        ]
        pool.run(jobs, _Steps(None, 0.0))
        return [found[path] for path in inputs]


class _Subject:
    """The missing work for one reference: first the references and the ray, then the rows."""

    def __init__(self, folder: SweepFolder, out: Path, reference: str, ray: Ray | None) -> None:
        self._folder, self._out, self._reference = folder, out, reference
        self._asked = ray
        self._ray: Ray | None = None
        self._curves: dict[str, Curve] = {}
        kept = sweep_curves.read(out, reference)
        if kept is not None and ray in {None, kept[0]}:
            self._ray, self._curves = kept
        self._plans: list[Plan] = []
        self._second: dict[tuple[str, str], tuple[Plan, float]] = {}
        self._waiting = 0
        self.weight = 0.0
        """Weight of all jobs."""

    def add(self, plan: Plan) -> None:
        """Add the rows that an input asks for; all inputs added have this reference."""
        self._plans.append(plan)
        for key, samples in plan.row_samples.items():
            row = self._row(key, plan)
            behind = row is not None and plan.converged not in {None, row.converged}
            if row is None or (behind and kept_image(self._out, key, plan.res) is None):
                self._second["row", key] = plan, samples
                continue
            if behind:
                self._second["measure", key] = plan, 0.1 * OVERHEAD
            if key not in self._curves:
                self._second["curve", key] = plan, samples

    def _row(self, key: str, plan: Plan) -> SweepRow | None:
        """Return an existing row, updated with the requested coefficients that it replaces in this sweep."""
        row, asked = self._folder.rows.get(key), plan.stands_for.get(key, ())
        if row is not None and not set(asked) <= set(row.stands_for):
            row = dataclasses.replace(row, stands_for=tuple(sorted({*row.stands_for, *asked})))
            self._folder.append(row)
        return row

    def begin(self) -> list[Job]:
        """Return the jobs that can be done first."""
        methods = {method for method, _ in self._second}
        plan = self._plans[0]
        first = []
        if self._ray is None and methods & {"row", "curve"}:
            weight = next(iter(plan.row_samples.values()))
            first.append(self._job("ray", plan, weight, "choosing a ray", self._asked))
        marches = {plan.reference: "reference"}
        if plan.converged is not None:
            marches.setdefault(plan.converged, "converged reference")
        for key, label in marches.items() if methods & {"row", "measure"} else ():
            if not self._folder.has_march(key, plan.res):
                first.append(self._job("march", plan, plan.march_samples[key], label, key))
        self._waiting = len(first)
        self.weight = sum(job.weight for job in first) + sum(weight for _, weight in self._second.values())
        return first or self._then()

    def done(self, job: Job, result: Any) -> list[Job]:
        """Keep the result of a job; returns the jobs that it makes possible."""
        if job.method in {"march", "ray"}:
            if job.method == "ray":
                self._ray = result
            self._waiting -= 1
            return [] if self._waiting else self._then()
        if job.method == "row":
            row, curve = result
            self._folder.append(row)
            if curve is not None:
                self._curves[row.key] = curve
        elif job.method == "curve":
            self._curves[job.arguments[1]] = result
        else:
            self._folder.append(result)
        return []

    def _then(self) -> list[Job]:
        jobs = []
        for (method, key), (plan, weight) in self._second.items():
            if method == "curve" and self._ray is None:
                continue
            what = (self._folder.rows[key],) if method == "measure" else (key, self._ray)
            jobs.append(self._job(method, plan, weight, _label(plan.variants[key]), *what))
        return jobs

    def _job(self, method: str, plan: Plan, weight: float, label: str, *arguments: Any) -> Job:
        return Job(method, (plan, *arguments), f"{plan.name}: {label}", weight, self.done)

    def write_curves(self) -> None:
        """Write the file of curves, if there are any."""
        if self._ray is not None:
            sweep_curves.write(self._out, self._reference, self._ray, self._curves, self._folder.rows)


def _label(settings: MapSettings) -> str:
    alpha = settings.density_weighting
    return f"{settings.basis} n={settings.coeffs}" + ("" if alpha == "auto" else f" α={alpha:g}")


def _names(inputs: Sequence[Path]) -> list[str]:
    """Name inputs by their stem if that distinguishes them, else by their path; valid UTF-8."""
    stems = [path.stem for path in inputs]
    names = (
        stem if stems.count(stem) == 1 else path.as_posix() for path, stem in zip(inputs, stems, strict=True)
    )
    return [name.encode(errors="backslashreplace").decode() for name in names]


def _say_nothing(line: str) -> None:
    """Ignore a notice."""


class _Steps:
    """Progress over jobs by their weight; it never decreases."""

    def __init__(self, progress: Progress | None, total: float) -> None:
        self._progress, self._total = progress, total
        self._done = 0.0
        self._reached = 0.0

    @contextlib.contextmanager
    def step(self, job: Job) -> Iterator[Progress]:
        """Report a job that runs in this process; yields the callback for it."""
        self._report(job.label, 0.0)
        yield lambda stage, fraction: self._report(f"{job.label}: {stage}", job.weight * fraction)
        self.finished(job)

    def finished(self, job: Job) -> None:
        """Count a finished job."""
        self._done += job.weight
        self._report(job.label, 0.0)

    def end(self) -> None:
        """Report that everything is done."""
        self._done = self._total
        self._report("sweep", 0.0)

    def _report(self, stage: str, weight: float) -> None:
        if self._progress is not None:
            fraction = (self._done + weight) / self._total if self._total else 1.0
            self._reached = max(self._reached, min(1.0, fraction))
            self._progress(stage, self._reached)
