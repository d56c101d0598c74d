"""Who may steer, and what is let through to the loop; knows no network."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from rcmqp.live.messages import LONGEST, Hand, Malformed, Ping, Said, Take, parse

STALE = 0.1
"""A hand's message that is older is not followed [s]."""

AHEAD = 0.05
"""By so much a page's clock may be ahead of the server's [s]."""

MOST = 300
"""Messages of one page in a second."""


@dataclass
class Counts:
    """How many messages of pages were passed on, and how many were dropped, by the reason.

    Attributes:
        hands: messages of the operator's hand that were passed on to the loop.
        lost: of these, and of the messages when a page closed, those that the loop did not take.
        malformed: messages that rcmqp's pages do not send.
        huge: messages longer than LONGEST letters.
        too_many: messages beyond MOST in a second.
        stale: messages older than STALE, or older than one that came before.
        watching: messages of a page that does not steer.
        foreign: connections from a page of another origin, or to a name that is not ours.
        wrong_token: requests and connections without the token.
    """

    hands: int = 0
    lost: int = 0
    malformed: int = 0
    huge: int = 0
    too_many: int = 0
    stale: int = 0
    watching: int = 0
    foreign: int = 0
    wrong_token: int = 0

    def rows(self) -> list[tuple[str, str]]:
        """For the report."""
        about = {
            "hands": "messages of the hand let through",
            "lost": "- lost, as the loop did not take them",
            "malformed": "- dropped, as they were malformed",
            "huge": "- dropped, as they were huge",
            "too_many": "- dropped, as they were too many",
            "stale": "- dropped, as they were older than 100 ms or out of order",
            "watching": "- dropped, as somebody else steers",
            "foreign": "connections refused: another origin",
            "wrong_token": "requests refused: wrong token",
        }
        return [(about[name], str(count)) for name, count in asdict(self).items()]


class Visitor:
    """One page that is connected; a page may become the operator's."""

    def __init__(self) -> None:
        self.number = -1
        self._second, self._came = 0.0, 0

    def comes_too_often(self, now: float) -> bool:
        """Count a message at ``now`` [s]; whether it is one too many."""
        if now - self._second >= 1.0:
            self._second, self._came = now, 0
        self._came += 1
        return self._came > MOST


class Desk:
    """One operator at a time; all others watch.

    Attributes:
        counts: of messages.
        operator: who steers; None for nobody.
    """

    def __init__(self) -> None:
        self.counts = Counts()
        self.operator: Visitor | None = None
        self._changes = 0

    def hear(self, visitor: Visitor, text: str, now: float) -> Hand | Ping | Take | Said | None:
        """What a visitor's message asks for; None where it is dropped.

        Args:
            visitor: whose message.
            text: as it came.
            now: by the server's clock [s].
        """
        counts = self.counts
        if visitor.comes_too_often(now) and not self._lets_go(visitor, text):
            counts.too_many += 1
            return None
        if len(text) > LONGEST:
            counts.huge += 1
            return None
        try:
            said = parse(text)
        except Malformed:
            counts.malformed += 1
            return None
        if isinstance(said, Said) and visitor is not self.operator:
            counts.watching += 1
            return None
        return self._passed(visitor, said, now) if isinstance(said, Hand) else said

    def _lets_go(self, visitor: Visitor, text: str) -> bool:
        """Whether the operator lets go: no such message is one too many."""
        if visitor is not self.operator or len(text) > LONGEST:
            return False
        try:
            said = parse(text)
        except Malformed:
            return False
        return isinstance(said, Hand) and not said.held

    def _passed(self, visitor: Visitor, hand: Hand, now: float) -> Hand | None:
        """The hand, if it is the operator's and new."""
        if visitor is not self.operator:
            self.counts.watching += 1
            return None
        if not -AHEAD <= now - hand.at <= STALE or hand.number <= visitor.number:
            self.counts.stale += 1
            return None
        visitor.number = hand.number
        self.counts.hands += 1
        return hand._replace(at=min(hand.at, now), operator=self._changes)

    def take(self, visitor: Visitor) -> bool:
        """Let a visitor steer if nobody does; return whether this one steers now."""
        if self.operator is None:
            self.operator = visitor
            self._changes += 1
        return self.operator is visitor

    def leave(self, visitor: Visitor) -> None:
        """A visitor has gone; if it steered, nobody does now."""
        if self.operator is visitor:
            self.operator = None
