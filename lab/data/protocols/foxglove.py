"""Foxglove: a solution as messages in JSON, and the WebSocket protocol that brings them to the program.

References
----------
Foxglove, *WebSocket protocol v1* (github.com/foxglove/ws-protocol, docs/spec.md): JSON with a field ``op``,
and binary messages that begin with 1, the number of the subscription and the time [ns]. The subprotocol
``foxglove.sdk.v1`` has the same messages for what is used here.
Foxglove, *Schemas*: LocationFix, whose covariance is that of east, north, up; FrameTransform.
"""

from __future__ import annotations

import json
import math
import struct
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.data.protocols.json_rows import parse_json
from lab.data.protocols.sent_solution import SentSolution, json_line

SUBPROTOCOLS: Final = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""Names of the protocol, the newer one first."""
_MESSAGE_DATA: Final = struct.Struct("<BIQ")
_LARGEST_NUMBER: Final = 2**32
"""First number that a subscription cannot have: it is sent in 32 bits."""
_ENU: Final = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Takes north, east, down to east, north, up."""
_FLU: Final = np.diag([1.0, -1.0, -1.0])
"""Takes forward, right, down to forward, left, up."""
_NUMBER: Final = {"type": "number"}
_TIME: Final = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


class Channel(NamedTuple):
    """A stream of messages of one kind.

    Attributes
    ----------
    number : int
        Number, from 1.
    topic : str
        Name.
    schema_name : str
        Name of the form of its messages.
    schema : str
        This form, as JSON schema.
    """

    number: int
    topic: str
    schema_name: str
    schema: str


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_LOCATION: Final = _object(
    timestamp=_TIME,
    frame_id={"type": "string"},
    latitude=_NUMBER,
    longitude=_NUMBER,
    altitude=_NUMBER,
    position_covariance={"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
    position_covariance_type={"type": "integer"},
)
"""Form of a place, as Foxglove's LocationFix."""
_TRANSFORM: Final = _object(
    timestamp=_TIME,
    parent_frame_id={"type": "string"},
    child_frame_id={"type": "string"},
    translation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER),
    rotation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
)
CHANNELS: Final = (
    Channel(1, "/ins_lab/solution", "ins_lab.Solution", json.dumps({"type": "object"})),
    Channel(2, "/ins_lab/location", "foxglove.LocationFix", json.dumps(_LOCATION)),
    Channel(3, "/tf", "foxglove.FrameTransform", json.dumps(_TRANSFORM)),
)
"""What is offered: the row as in lines of JSON, the position for a map, and the attitude for a scene."""


def time_stamp(solution: SentSolution) -> int:
    """Return the time of the messages of a solution, by the clock of the computer [ns since 1970]."""
    return 1000 * round(1e6 * solution.unix)


def make_messages(solution: SentSolution) -> dict[int, bytes]:
    """Return the messages of a solution by the numbers of their channels, without those that lack contents.

    The altitude of a LocationFix is above the ellipsoid, and left out where that is not known. A heading that
    is relative turns the body in the scene too.
    """
    now = dict(zip(("sec", "nsec"), divmod(time_stamp(solution), 1_000_000_000), strict=True))
    found = {1: json_line(solution).rstrip()}
    if solution.has_position:
        fix = {
            "timestamp": now,
            "frame_id": "ins_lab",
            "latitude": solution.latitude,
            "longitude": solution.longitude,
        }
        if math.isfinite(solution.ellipsoid_height):
            fix["altitude"] = solution.ellipsoid_height
        covariance = _ENU @ solution.position_covariance @ _ENU.T
        if np.isfinite(covariance).all():
            # Type 3: the whole covariance is known.
            fix |= {"position_covariance": covariance.ravel().tolist(), "position_covariance_type": 3}
        found[2] = json.dumps(fix, allow_nan=False).encode()
    if solution.has_attitude:
        roll, pitch, heading = solution.euler.tolist()
        C_nb = Rotation.from_euler("ZYX", (heading, pitch, roll), degrees=True).as_matrix()
        # Forward, left, up to forward, right, down, to north, east, down, to east, north, up.
        turn = Rotation.from_matrix(_ENU @ C_nb @ _FLU).as_quat()
        transform = {
            "timestamp": now,
            "parent_frame_id": "enu",
            "child_frame_id": "body",
            "translation": dict.fromkeys("xyz", 0.0),
            "rotation": dict(zip("xyzw", turn.tolist(), strict=True)),
        }
        found[3] = json.dumps(transform, allow_nan=False).encode()
    return found


class Conversation:
    """One program on a WebSocket: what it asked for, and what it gets.

    Nothing that it sends has another effect. It may leave, ask again, and send what is no message.
    """

    def __init__(self) -> None:
        self._channels: dict[int, int] = {}  # by the numbers of subscriptions

    @staticmethod
    def greetings() -> tuple[str, str]:
        """Return what the program is told when it has come: who speaks, and the channels."""
        info = {"op": "serverInfo", "name": "INS Lab", "capabilities": [], "metadata": {}}
        channels = [
            {
                "id": one.number,
                "topic": one.topic,
                "encoding": "json",
                "schemaName": one.schema_name,
                "schema": one.schema,
                "schemaEncoding": "jsonschema",
            }
            for one in CHANNELS
        ]
        return json.dumps(info), json.dumps({"op": "advertise", "channels": channels})

    def accept(self, message: str | bytes) -> None:
        """Take a message of the program; what is no subscription is left out."""
        said = parse_json(message.encode() if isinstance(message, str) else b"")
        if not isinstance(said, dict):
            return
        if said.get("op") == "subscribe":
            for one in _to_list(said.get("subscriptions")):
                number, channel = (one.get("id"), one.get("channelId")) if isinstance(one, dict) else (0, 0)
                if type(number) is not int or type(channel) is not int or not 0 <= number < _LARGEST_NUMBER:
                    continue
                if channel in {offered.number for offered in CHANNELS}:
                    self._channels = {key: value for key, value in self._channels.items() if value != channel}
                    self._channels[number] = channel
        elif said.get("op") == "unsubscribe":
            for one in _to_list(said.get("subscriptionIds")):
                if type(one) is int:
                    self._channels.pop(one, None)

    def written(self, time: int, messages: dict[int, bytes]) -> list[bytes]:
        """Return messages as the program asked for them; of `make_messages`, with `time_stamp` [ns]."""
        return [
            _MESSAGE_DATA.pack(1, subscription, time) + messages[channel]
            for subscription, channel in self._channels.items()
            if channel in messages
        ]


def _to_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
