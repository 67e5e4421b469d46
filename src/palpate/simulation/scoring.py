"""Scores of a training session: time, path, force, strain, and the target."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.simulation.pointer import TOOLS, ContactState
from palpate.simulation.principal_stretch import Stretch
from palpate.simulation.recorded_session import session_like
from palpate.simulation.recording import Record
from palpate.simulation.session import LUMP, RATE, SAMPLE, Session
from palpate.simulation.target_regions import Lump, connected_lumps
from palpate.simulation.training_task import Task, region_name, target_of
from palpate.tissue.tissue import Tissue

EVERY = 10  # ticks between looks at the tools
STRAIN_EVERY = 100  # ticks between looks at the tissue
CLAIMS = ("lump", "sample")


@dataclass(frozen=True)
class Claim:
    """What the trainee claimed to have found. seconds: when. what: "lump" or "sample". tool: which.

    right: whether it was. lump: which of them, or -1. distance: mm to that lump's skin, 0 inside it; of a lump under a
    tool from the place touched, at rest; of a sample from the needle's tip, in the tissue as it was deformed. nearest:
    mm, the least that the distance could have been. centre: mm from the needle's tip to the middle of the lump.
    Distances are None where no tool was, or nothing is sought.
    """

    seconds: float
    what: str
    tool: int
    right: bool
    lump: int = -1
    distance: float | None = None
    nearest: float | None = None
    centre: float | None = None


@dataclass(frozen=True, eq=False)
class Score:
    """Scores of a session. Lengths are mm, forces N on a tool, times seconds of the loop.

    Parameters
    ----------
    task : Task
        What was asked.
    target : str
        Name of the region sought, or empty.
    seconds : float
        From the first touch to the last right claim, or to the last touch if a lump was not found.
    path : tuple of float
        Path length of each tool's tip while it worked.
    touches, punctures : int
        How often a tool took hold, and how often a needle went in.
    mean_force, max_force : float
        Mean over the ticks with force, and largest force.
    over_force : float
        Seconds in which a tool felt more than the task's limit.
    work : float
        Work on the tissue, N mm.
    max_strain : float
        Largest principal stretch − 1 of any tetrahedron.
    over_strain, strained : float
        Seconds in which a tetrahedron exceeded the limit, and volume of all that ever did, mm³.
    claims : tuple of Claim
        The claims in order.
    found, sought : int
        Number of lumps.
    time, force : ndarray
        Curve of the largest force of any tool.
    strain_time, strain : ndarray
        Curve of the largest strain.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.score(session.record(), tissue).touches
    1
    """

    task: Task
    target: str
    seconds: float
    path: tuple[float, ...]
    touches: int
    punctures: int
    mean_force: float
    max_force: float
    over_force: float
    work: float
    max_strain: float
    over_strain: float
    strained: float
    claims: tuple[Claim, ...]
    found: int
    sought: int
    time: Float64
    force: Float64
    strain_time: Float64
    strain: Float64

    @property
    def wrong(self) -> int:
        """Number of claims that were not right."""
        return sum(not claim.right for claim in self.claims)

    def values(self) -> dict[str, object]:
        """Return all values except the curves, for a file.

        Returns
        -------
        dict of str to object
            Values by name.
        """
        curves = ("time", "force", "strain_time", "strain", "claims", "task", "path")
        plain = {name: value for name, value in vars(self).items() if name not in curves}
        claims = [asdict(claim) for claim in self.claims]
        return {"task": asdict(self.task), **plain, "path": list(self.path), "wrong": self.wrong, "claims": claims}

    def text(self) -> str:
        """Return the score in a few lines, for a terminal.

        Returns
        -------
        str
            The lines.
        """
        lines = [
            f"time {self.seconds:.1f} s, way of the tools {sum(self.path) / 10:.1f} cm, {self.touches} touches",
            f"force: mean {self.mean_force:.2f} N, most {self.max_force:.2f} N, "
            f"{self.over_force:.1f} s above {self.task.force:g} N; work {self.work:.1f} mJ",
            f"strain: most {self.max_strain:.0%}, {self.over_strain:.1f} s above {self.task.strain:.0%}, "
            f"in {self.strained / 1000:.2f} ml of tissue",
        ]
        if self.sought:
            lines.append(f"{self.target}: {self.found} of {self.sought} found, {self.wrong} wrong claims")
        if self.punctures:
            lines.append(f"needle: {self.punctures} punctures")
        return "\n".join(lines)


def score(
    record: Record,
    tissue: Tissue,
    task: Task | None = None,
    *,
    progress: Callable[[float], None] = lambda share: None,
) -> Score:
    """Score a recorded session by replaying it on its tissue.

    Parameters
    ----------
    record : Record
        The session.
    tissue : Tissue
        The tissue that it was made on.
    task : Task, optional
        What was asked.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    Score
        The score.

    Raises
    ------
    DataError
        If the record was made on another tissue, the tissue lacks the target, or it was cut in the session.
    MeshError
        If the tissue had been cut before.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.score(session.record(), tissue, pp.Task("lump")).sought
    1
    """
    refuse_cut(tissue.mesh, "score", "score a session on the tissue before the cut")
    if record.cuts:
        raise DataError("score: tissue was cut in this session, and scores of that are not built; replay shows it")
    session = session_like(record, tissue)
    watch = SessionScorer(session, task or Task())
    marks = [mark for mark in record.marks if mark[1] in (LUMP, SAMPLE)]

    def claimed(until: int) -> None:
        while marks and marks[0][0] <= until:
            _, what, tool = marks.pop(0)
            watch.mark(what, tool)

    claimed(0)
    for done, force in session.replayed(record, EVERY):
        watch.see(force)
        claimed(done)
        if done % RATE == 0 or done >= record.length:
            progress(done / record.length)
    return watch.score()


class SessionScorer:
    """Scores a session in lockstep: call `see` after each step, `mark` after each claim, `score` at the end.

    A step must not go past a multiple of `EVERY` ticks, so that one session is looked at like another.
    """

    def __init__(self, session: Session, task: Task) -> None:
        tissue = session.first.tissue
        label = target_of(task, tissue)
        self.session, self.task = session, task
        self.target = "" if label is None else region_name(tissue.mesh, label)
        self.lumps: list[Lump] = [] if label is None else connected_lumps(tissue.mesh, label)
        self.stretch = Stretch(tissue.mesh)
        self.strained = np.zeros(len(tissue.mesh.tets), dtype=bool)
        self.ticks = 0
        self.first_touch, self.last_touch = -1, 0
        self.forces: list[Float64] = []  # (ticks, 4) N
        self.strains: list[tuple[float, float]] = []
        self.claims: list[Claim] = []
        self.path, self.depths = [0.0] * TOOLS, [0.0] * TOOLS
        self.tips: list[Any] = [None] * TOOLS
        self.held = [False] * TOOLS
        self.touches = self.punctures = 0
        self.over_strain = 0.0

    def see(self, force: Float64) -> None:
        """What the last ticks gave: (ticks, 4, 3) N."""
        before, self.ticks = self.ticks, self.ticks + len(force)
        if before // EVERY < (self.ticks - 1) // EVERY:
            raise DataError(f"score: a step from tick {before} to {self.ticks}; take at most {EVERY} at a time")
        self.forces.append(np.linalg.norm(force, axis=2))
        if self.ticks % EVERY == 0:
            self._look_at_tools()
        if self.ticks % STRAIN_EVERY == 0:
            self._look_at_tissue()

    def _look_at_tools(self) -> None:
        frame = self.session.frame()
        for tool, (contact, tip, inside) in enumerate(zip(frame.contact, frame.tip, frame.insertion, strict=True)):
            holds = contact == ContactState.closed
            at_work = holds or contact == ContactState.open
            if at_work and self.tips[tool] is not None:
                self.path[tool] += float(np.linalg.norm(np.subtract(tip, self.tips[tool])))
            self.tips[tool] = tip if at_work else None
            self.touches += holds and not self.held[tool]
            self.punctures += inside > 0 and self.depths[tool] == 0
            self.held[tool], self.depths[tool] = holds, inside
            if holds:
                self.first_touch = self.ticks if self.first_touch < 0 else self.first_touch
                self.last_touch = self.ticks

    def _look_at_tissue(self) -> None:
        strain = self.stretch(self.session.displacement)
        above = strain > self.task.strain
        self.strained |= above
        self.over_strain += STRAIN_EVERY / RATE * bool(above.any())
        self.strains.append((self.ticks / RATE, float(strain.max())))

    def mark(self, what: int, tool: int) -> None:
        """What the hand claims now, judged by where its tool is."""
        claim = partial(Claim, self.ticks / RATE, CLAIMS[what], tool)
        frame = self.session.frame()
        held = frame.contact[tool] == ContactState.closed
        if what == SAMPLE:
            self.claims.append(self._sample(frame, tool, claim) if frame.insertion[tool] > 0 else claim(False))
        else:
            self.claims.append(self._lump(frame.point[tool], claim) if held else claim(False))

    def _lump(self, point: Float64, claim: Callable[..., Claim]) -> Claim:
        if not self.lumps:
            return claim(False)
        distance, number = min((lump.distance(point), k) for k, lump in enumerate(self.lumps))
        nearest = self.lumps[number].depth
        right = self.task.kind == "lump" and distance <= nearest + self.task.within
        return claim(right, number, distance, nearest)

    def _sample(self, frame: object, tool: int, claim: Callable[..., Claim]) -> Claim:
        """The tip: from where the needle entered, as far as the tissue there was carried along, and on by its depth."""
        if not self.lumps:
            return claim(False)
        point, moved, axis = (np.array(getattr(frame, name)[tool]) for name in ("point", "displacement", "axis"))
        tip = point + moved + frame.insertion[tool] * axis  # type: ignore[attr-defined]
        u = self.session.displacement
        distance, number = min((lump.distance(tip, u), k) for k, lump in enumerate(self.lumps))
        centre = float(np.linalg.norm(tip - self.lumps[number].centre(u)))
        return claim(self.task.kind == "biopsy" and distance == 0, number, distance, 0.0, centre)

    def score(self) -> Score:
        """All that was seen."""
        force = np.concatenate([np.empty((0, TOOLS)), *self.forces])
        found = {claim.lump for claim in self.claims if claim.right}
        done = bool(self.lumps) and len(found) == len(self.lumps)
        last_right = max((claim.seconds for claim in self.claims if claim.right), default=0.0)
        begun = max(self.first_touch, 0) / RATE
        felt = force[force > 0]
        starts = np.arange(0, len(force), EVERY)
        most = force.max(axis=1, initial=0.0)
        strain_time, strain = np.array(self.strains).reshape(-1, 2).T
        return Score(
            task=self.task,
            target=self.target,
            seconds=(last_right if done else self.last_touch / RATE) - begun,
            path=tuple(self.path),
            touches=self.touches,
            punctures=self.punctures,
            mean_force=float(felt.mean()) if len(felt) else 0.0,
            max_force=float(force.max(initial=0.0)),
            over_force=float(np.count_nonzero(most > self.task.force)) / RATE,
            work=float(self.session.frame().work),
            max_strain=float(strain.max(initial=0.0)),
            over_strain=self.over_strain,
            strained=float(self.session.mesh.volumes[self.strained].sum()),
            claims=tuple(self.claims),
            found=len(found),
            sought=len(self.lumps),
            time=np.minimum(starts + EVERY, len(force)) / RATE,
            force=np.maximum.reduceat(most, starts) if len(force) else most,
            strain_time=strain_time,
            strain=strain,
        )
