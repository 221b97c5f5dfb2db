"""Requests that are refused and change nothing, each with its advice to the page."""

from __future__ import annotations

from causal_openlock.errors import OpenLockError
from causal_openlock.play.game import Answer


class Refused(OpenLockError):  # noqa: N818 - an answer to the page
    """A request that changes nothing.

    Attributes:
        status: Its status in HTTP.
        advice: What the researcher is told; empty where there is nothing for them to do.
    """

    status = 400
    advice = ""


class UnknownPerson(Refused):
    """There is no such session."""

    status = 404


class OutOfTurn(Refused):
    """The request is not meant for the turn that the person is at.

    Attributes:
        now: What the person may know now.
    """

    status = 409

    def __init__(self, now: Answer) -> None:
        super().__init__("this is not the turn that the session is at")
        self.now = now


class TooManyPeople(Refused):
    """The folder is full: no more people can join."""

    status = 429
    advice = "a person could not join: this folder is full; start again with another --out"


class NotIdentified(Refused):
    """A person comes without the identifiers that a recruiting service should have given them."""

    def __init__(self, what: str) -> None:
        super().__init__(what)
        self.advice = f"a person could not join: {what}; check the address that the service has"


class HasBegun(Refused):
    """A person who has begun joins again, and not from the browser that has their session."""

    status = 403

    def __init__(self, number: int) -> None:
        super().__init__("whoever has this identifier began in another browser")
        self.advice = (
            f'person {number} ("join":{number} in recruited.jsonl) came back from another browser; '
            "to let them continue, start again with --readmit and their identifier"
        )


class HasFinished(Refused):
    """A person who has played to the end asks to play again."""

    status = 410


class NotAgreed(Refused):
    """A person asks to join who has not agreed to the consent as it is now."""

    status = 403
