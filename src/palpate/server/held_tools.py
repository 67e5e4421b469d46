"""Which page holds each of the session's tools. A page numbers its own."""

from dataclasses import dataclass, field

from starlette.websockets import WebSocket

from palpate.simulation.pointer import TOOLS, Command, Pointer

Hand = tuple[WebSocket, int]  # a page, and its own number of a tool
MOST_SERIALS = 1024  # of a page's commands that no frame has obeyed yet


@dataclass(eq=False)
class HeldTools:
    """Used on the event loop's thread only.

    shared: each page has tools of its own, as far as the session's suffice; otherwise two pages that command a tool of the
    same number mean the same one, and the first holds it. holders: of each tool that is held. A tool is held from a page's
    first command until it lets go. waiting: the newest commands of hands that are stopped. taken: hands whose tools
    another one has got: they begin anew after they have let go.
    """

    pointer: Pointer
    shared: bool = False
    holders: dict[int, Hand] = field(default_factory=dict)
    waiting: dict[Hand, tuple[Command, int]] = field(default_factory=dict)
    taken: set[Hand] = field(default_factory=set)
    serials: dict[WebSocket, list[tuple[int, int]]] = field(default_factory=dict)
    sent: int = 0

    def command(self, page: WebSocket, number: int, command: Command, serial: int, stopped: bool = False) -> bool:
        """Commands a tool; False if all are held by others. stopped: it stays as it is until `resume`."""
        hand = (page, number)
        if hand in self.taken:
            if not command.held:
                self.taken.discard(hand)
            return True
        if stopped:
            self.waiting[hand] = command, serial
            return True
        tool = self.tool(page, number)
        if tool is None and command.held:
            tool = self._free(number)
        if tool is None:
            return not command.held
        if command.held:
            self.holders[tool] = hand
        else:
            del self.holders[tool]
        self.pointer.send(command, self._counted(page, serial), tool)
        return True

    def go_on(self, page: WebSocket, number: int, command: Command) -> None:
        """Commands a tool by another message than its own, which counts none; nothing if all are held by others."""
        known = self.serials.get(page)
        self.command(page, number, command, known[-1][1] if known else 0 if self.shared else self.pointer.serial)

    def tool(self, page: WebSocket, number: int) -> int | None:
        """The session's tool that this is, if it is held."""
        return next((tool for tool, hand in self.holders.items() if hand == (page, number)), None)

    def _free(self, number: int) -> int | None:
        """The tool of that number, or another one, if it is shared and that one is held."""
        numbers = [number, *range(TOOLS)] if self.shared else [number]
        return next((tool for tool in numbers if tool not in self.holders), None)

    def resume(self) -> None:
        """Obeys what was commanded meanwhile."""
        waiting, self.waiting = self.waiting, {}
        for (page, number), (command, serial) in waiting.items():
            self.command(page, number, command, serial)

    def take_over(self, giver: WebSocket, taker: WebSocket) -> None:
        """The tools of one page go to another one as they are; its own of the same number let go first."""
        for tool, (page, number) in list(self.holders.items()):
            if page is not giver:
                continue
            own = self.tool(taker, number)
            if own is not None:
                self._let_go(own)
            self.holders[tool] = (taker, number)
            self.taken.add((giver, number))
            self.waiting.pop((giver, number), None)

    def release(self, page: WebSocket) -> None:
        """The tools of a page let go; it begins anew."""
        for tool, hand in list(self.holders.items()):
            if hand[0] is page:
                self._let_go(tool)
                self.taken.add(hand)
                self.waiting.pop(hand, None)

    def leave(self, page: WebSocket) -> None:
        """A page has gone: its tools let go."""
        for tool, hand in list(self.holders.items()):
            if hand[0] is page:
                self._let_go(tool)
        self.waiting = {hand: each for hand, each in self.waiting.items() if hand[0] is not page}
        self.taken = {hand for hand in self.taken if hand[0] is not page}
        self.serials.pop(page, None)

    def let_go(self) -> None:
        """All tools let go, those of no page too; hands that hold go on with their next command."""
        self.holders.clear()
        self.waiting.clear()
        self.taken.clear()
        for tool in range(TOOLS):
            self._send_away(tool)

    def _let_go(self, tool: int) -> None:
        del self.holders[tool]
        self._send_away(tool)

    def _send_away(self, tool: int) -> None:
        if self.shared:
            self.sent += 1
        self.pointer.send(Command(), self.sent if self.shared else None, tool)

    def _counted(self, page: WebSocket, serial: int) -> int:
        """The number that the session is told: among several hands one count of all commands."""
        if not self.shared:
            return serial
        self.sent += 1
        known = self.serials.setdefault(page, [])
        known.append((self.sent, serial))
        if len(known) > MOST_SERIALS:
            del known[0]
        return self.sent

    def obeyed(self, page: WebSocket, sent: int) -> int:
        """A page's own number of its newest command among those that a frame obeys."""
        known = self.serials.get(page, [])
        while len(known) > 1 and known[1][0] <= sent:
            del known[0]
        return known[0][1] if known and known[0][0] <= sent else 0
