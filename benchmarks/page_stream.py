"""A made-up organ that answers at once, served as `palpate touch` serves one: the page's own work, without a loop's.

Not a model of tissue: each tool drags its neighbourhood along with a smooth bump.
"""

import asyncio
import contextlib
import json
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.arrays import AnyArray, Float64
from palpate.server.access_control import by_token, page_application
from palpate.server.access_token import access_token
from palpate.server.json_messages import Scene
from palpate.server.loopback_server import running
from palpate.server.message_checks import decode
from palpate.server.messages import Frame, Mark, Part, Selection, ToolCommand, encode
from palpate.simulation.pointer import TOOLS

RATE = 60
STEPS = 32767
STIFF = 0.08  # N/mm
PIERCED = 2.0  # mm that the tissue goes with a needle


@dataclass(eq=False)
class Stream:
    """The organ, what the tools do, and what the page has said."""

    nodes: Float64
    triangles: AnyArray
    scene: Scene
    tools: list[ToolCommand] = field(
        default_factory=lambda: [ToolCommand(i, 0, 0, (0, 0, 0), (0, 0, 0)) for i in range(TOOLS)]
    )
    serial: int = 0
    model: int = 0
    said: list[Selection | Mark] = field(default_factory=list)
    sent: int = 0  # frames
    swings: bool = False  # the tools go in and out by themselves
    bumps: dict[int, tuple[tuple[float, ...], Float64]] = field(default_factory=dict)

    def obey(self, said: ToolCommand | Selection | Mark) -> None:
        """Takes a command in."""
        if isinstance(said, ToolCommand):
            self.tools[said.tool] = said
            self.serial = said.serial
            return
        self.said.append(said)
        if isinstance(said, Selection) and said.kind == 0:
            self.model = said.index

    def displacement(self, share_of_way: float = 1.0) -> Float64:
        """(nodes, 3) mm: a bump around each tool."""
        moved = np.zeros_like(self.nodes)
        for tool in self.tools:
            if not tool.kind:
                continue
            known = self.bumps.get(tool.tool)
            if known is None or known[0] != tool.point:
                far = np.linalg.norm(self.nodes - tool.point, axis=1) / (3 * self.scene.radius)
                known = self.bumps[tool.tool] = tool.point, np.maximum(0, 1 - far**2) ** 2
            share = share_of_way * (0.1 if tool.kind == 2 else 1.0)
            moved += share * known[1][:, None] * np.array(tool.displacement)
        return moved

    def frame(self, seconds: float) -> bytes:
        """The newest state as a message."""
        share = 0.6 + 0.4 * float(np.sin(6 * seconds)) if self.swings else 1.0
        moved = self.displacement(share)
        most = float(np.abs(moved).max())
        step = most / STEPS if most > 1e-4 else 0.0
        held = [tool.kind > 0 for tool in self.tools]
        asked = share * np.array([tool.displacement for tool in self.tools]) * np.array(held)[:, None]
        far = np.linalg.norm(asked, axis=1)
        inside = np.maximum(0, far - PIERCED) * [tool.kind == 2 for tool in self.tools]
        way = asked * (1 - inside / np.maximum(far, PIERCED))[:, None]
        message = Frame(
            model=self.model,
            tick=float(round(1000 * seconds)),
            late=0.0,
            faults=0,
            serial=self.serial,
            seconds=seconds,
            busy=1e-4,
            energy=float(STIFF * (way**2).sum() / 2),
            contact=tuple(int(on) for on in held),
            point=tuple(x for tool in self.tools for x in tool.point),
            displacement=tuple(way.ravel()),
            force=tuple((-STIFF * way).ravel()),
            insertion=tuple(inside.tolist()),
            chosen=self.model,
            mesh_error=float("nan"),
            stiffness_spread=float("nan"),
            linearisation=float("nan"),
            least_volume=float("nan"),
            solution_age=0.0,
            solution_error=0.0,
            body=0,
            step=step,
            count=len(moved) if step else 0,
        )
        return encode(message, np.rint(moved / step).astype("<i2") if step else None)

    def scene_bytes(self) -> bytes:
        """The scene as `messages.Scene` says."""
        text = json.dumps(asdict(self.scene)).encode()
        text += b" " * (-len(text) % 4)
        return (
            struct.pack("<I", len(text))
            + text
            + self.nodes.astype("<f4").tobytes()
            + self.triangles.astype("<u4").tobytes()
        )


def stream(frequency: int, **more: Any) -> Stream:
    """An ellipsoid of 20 `frequency`² triangles with a smaller one inside; `more`: what differs in its scene."""
    nodes, triangles = geodesic(frequency)
    shell = nodes * [40.0, 30.0, 25.0]
    inner, inside = geodesic(8)
    lump = inner * 7.0 + [0.0, 0.0, 12.0]
    scene = Scene(
        title="Made-up organ",
        model="made up",
        nodes=len(shell) + len(lump),
        triangles=len(triangles) + len(inside),
        parts=[Part("organ", 0, len(triangles), False), Part("lump", len(triangles), len(inside), True)],
        gapes=False,
        lips=[len(shell) + len(lump)],
        body=0,
        made=0,
        depth=0.0,
        tools=["press", "pull", "grasp", "needle"],
        views=["plain", "displacement", "strain", "stiffness", "error", "wireframe", "inside"],
        exam=False,
        elements=3 * len(triangles),
        radius=6.0,
        reach=55.0,
        limit=20.0,
        rate=1000,
        replay=False,
        front=0.0,
        models=["one", "other"],
        organs=["coarse", "fine"],
        organ=0,
        task="",
        reason="",
        images=False,
    )
    return Stream(
        np.concatenate([shell, lump]), np.concatenate([triangles, inside + len(shell)]), replace(scene, **more)
    )


def geodesic(frequency: int) -> tuple[Float64, AnyArray]:
    """Points on the unit ball and triangles: an icosahedron's faces, each cut into frequency² pieces."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)], dtype=float)
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    near = np.linalg.norm(corners[:, None] - corners[None], axis=2) < 2.1
    faces = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]
    ]
    points, triangles = [], []
    f = frequency
    for i, j, k in faces:
        a, b, c = corners[[i, j, k]]
        if np.dot(np.cross(b - a, c - a), a) < 0:
            b, c = c, b
        start = sum(map(len, points))
        rows = [(u, v) for u in range(f + 1) for v in range(f + 1 - u)]
        at = {uv: start + n for n, uv in enumerate(rows)}
        points.append(np.array([a + (b - a) * u / f + (c - a) * v / f for u, v in rows]))
        for u, v in rows:
            if u + v < f:
                triangles.append((at[u, v], at[u + 1, v], at[u, v + 1]))
            if u + v < f - 1:
                triangles.append((at[u + 1, v], at[u + 1, v + 1], at[u, v + 1]))
    ball = np.concatenate(points)
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    _, first, where = np.unique(np.rint(ball * 1e6), axis=0, return_index=True, return_inverse=True)
    return ball[first], where.ravel()[np.array(triangles)]


def application(organs: list[Stream], token: str) -> Starlette:
    """The app: the page and the stream of the chosen organ. Another choice closes the socket with 4001."""
    chosen = [0]

    async def scene(_: Request) -> Response:
        return Response(organs[chosen[0]].scene_bytes(), media_type="application/octet-stream")

    async def talk(page: WebSocket) -> None:
        await page.accept()
        here = organs[chosen[0]]
        sender = asyncio.create_task(send(page, here))
        try:
            while True:
                said = decode(await page.receive_bytes())
                here.obey(said)
                if isinstance(said, Selection) and said.kind == 1 and said.index < len(organs):
                    chosen[0] = said.index
                    await page.close(4001)
                    return
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            sender.cancel()

    app = page_application("index.html", [Route("/scene", scene), WebSocketRoute("/socket", talk)], by_token(token))
    return app


async def send(page: WebSocket, organ: Stream) -> None:
    """Frames at the rate of the display, by absolute deadlines."""
    began = due = time.perf_counter()
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            due += 1 / RATE
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            await page.send_bytes(organ.frame(time.perf_counter() - began))
            organ.sent += 1


@contextlib.contextmanager
def streaming(organs: list[Stream], listener: socket.socket) -> Iterator[str]:
    """Serves made-up organs while the block lasts. Gives the page's address."""
    token = access_token()
    with running(application(organs, token), listener) as address:
        yield f"{address}?token={token}"
