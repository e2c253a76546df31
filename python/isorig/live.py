"""Live samples of a rig over LCM, with what was missed."""

from __future__ import annotations

import ipaddress
import socket
import struct
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Iterator, Optional, Type
from urllib.parse import parse_qsl, urlsplit

from .errors import BadInput, IsorigError
from .log import TYPES

#: The daemon's own (docs/lcm-channels.md).
DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
_SHORT = 0x4C433032  # "LC02": a message that is one datagram
_RECEIVE_BUFFER = 4 << 20


@dataclass(frozen=True)
class Message:
    """channel: "ISORIG_FRAME", ... data: as the class of `isorig_msgs` that it has; `data.number` counts the channel's
    messages. missed: how many of this channel were skipped before this one; -1 for one that comes late and had been
    counted as missed."""

    channel: str
    data: Any
    missed: int


class GapCounter:
    """Counts what a subscriber missed of one channel: give it every message's number. Networks reorder (LCM's ttl > 0):
    a message that comes up to MOST_LATE messages late is taken back from the count. A larger step back is a new
    publisher's; so is a smaller one to 0, which all begin with, when no greater number follows than was there before.

    >>> gaps = GapCounter()
    >>> [gaps.next(number) for number in (100, 103, 101, 104)]  # 101 and 102 are missed; 101 comes late
    [0, 2, -1, 0]
    >>> gaps.next(2)  # a new daemon, of which 0 and 1 were missed
    2
    """

    MOST_LATE = 64

    def __init__(self) -> None:
        self._newest = -1
        self._missed = 0  # bit k: newest - 1 - k did not come
        self._zero_came_again = False

    def next(self, number: int) -> int:
        """What this message changes the count of missed messages by: how many were skipped before it, or -1 for a late
        one that had been counted as missed."""
        if number < 0:
            return 0  # no publisher's: they count from 0
        zero_came_again, self._zero_came_again = self._zero_came_again, False
        if self._newest < 0:  # what was sent before somebody subscribed is not missed
            self._newest = number
            return 0
        if self._newest - number > self.MOST_LATE:
            return self._begin(number)
        if zero_came_again and 0 < number <= self._newest:
            self._begin(0)
        if number > self._newest:
            step = number - self._newest
            kept = self._missed << step if step < self.MOST_LATE else 0
            self._missed = (kept | self._lowest(step - 1)) & self._lowest(self.MOST_LATE)
            self._newest = number
            return step - 1
        if number == self._newest:
            return 0
        bit = 1 << (self._newest - number - 1)
        if not self._missed & bit:
            self._zero_came_again = number == 0
            return 0
        self._missed &= ~bit
        return -1

    def _begin(self, number: int) -> int:
        self._newest, self._missed = number, self._lowest(number)
        return number

    @classmethod
    def _lowest(cls, bits: int) -> int:
        return (1 << min(bits, cls.MOST_LATE)) - 1


class Live:
    """A subscription: `for message in Live(): ...`; as a context manager it is closed at the end.

    LCM drops in silence. Each message of isorig has a number, so that what was missed is counted: `missed` of each
    message, and `dropped` by channel. The receive buffer is 4 MiB (14 s of a rig's streams) where the kernel allows it
    (sysctl net.core.rmem_max). Messages that are no isorig's, or of another version of its types, are counted in
    `foreign`.
    """

    def __init__(self, url: str = DEFAULT_URL, channels: "Optional[tuple[str, ...]]" = None) -> None:
        """channels: None for all of TYPES."""
        group, port, options = _parsed(url)
        unknown = [each for each in channels or () if each not in TYPES]
        if unknown:
            raise BadInput(f"{unknown[0]}: not a channel of isorig; it has {', '.join(TYPES)}")
        self.url = url
        self.channels = frozenset(channels or TYPES)
        self.dropped: "dict[str, int]" = {}
        self.received: "dict[str, int]" = {}
        self.foreign = 0
        self._gaps: "dict[str, GapCounter]" = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            size = int(options.get("recv_buf_size", _RECEIVE_BUFFER))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
            self._socket.bind((group, port))
            membership = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton("0.0.0.0"))
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        except OSError as e:
            self._socket.close()
            raise IsorigError(f"{url}: cannot subscribe: {e.strerror}; is there a route for multicast? ip link set lo "
                              "multicast on; ip route add 224.0.0.0/4 dev lo (docs/lcm-channels.md)") from None

    def receive(self, timeout_s: Optional[float] = None) -> Optional[Message]:
        """The next message; None when none has come in `timeout_s` (None: waits for ever)."""
        until = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            left = None if until is None else until - time.monotonic()
            if left is not None and left <= 0:
                return None
            self._socket.settimeout(left)
            try:
                packet = self._socket.recv(65536)
            except socket.timeout:
                return None
            message = self._decoded(packet)
            if message is not None:
                return message

    def _decoded(self, packet: bytes) -> Optional[Message]:
        if len(packet) < 9 or int.from_bytes(packet[:4], "big") != _SHORT or b"\0" not in packet[8:]:
            self.foreign += 1  # no message of isorig is longer than a datagram: pieces are of others
            return None
        name, _, body = packet[8:].partition(b"\0")
        channel = name.decode("ascii", "replace")
        if channel not in TYPES:
            self.foreign += 1
            return None
        if channel not in self.channels:
            return None
        try:
            data = TYPES[channel].decode(body)
        except (ValueError, struct.error):
            self.foreign += 1
            return None
        missed = self._gaps.setdefault(channel, GapCounter()).next(data.number)
        self.dropped[channel] = self.dropped.get(channel, 0) + missed
        self.received[channel] = self.received.get(channel, 0) + 1
        return Message(channel, data, missed)

    def __iter__(self) -> Iterator[Message]:
        while True:
            message = self.receive()
            if message is not None:
                yield message

    def close(self) -> None:
        """Ends the subscription."""
        self._socket.close()

    def __enter__(self) -> "Live":
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], value: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()


def _parsed(url: str) -> "tuple[str, int, dict[str, str]]":
    """Group, port and options of LCM's `udpm://239.255.76.67:7667?ttl=0`."""
    def wrong(what: str) -> BadInput:
        return BadInput(f"{url}: {what}; an LCM URL is like {DEFAULT_URL}")
    try:
        parts = urlsplit(url)
        group, port = parts.hostname or "239.255.76.67", parts.port or 7667
        options = dict(parse_qsl(parts.query, strict_parsing=bool(parts.query)))
        if parts.scheme != "udpm":
            raise wrong("only udpm:// is known here")
        if not ipaddress.IPv4Address(group).is_multicast:
            raise wrong(f"{group} is no multicast address")
        if "recv_buf_size" in options and int(options["recv_buf_size"]) <= 0:
            raise wrong("recv_buf_size is a number of bytes")
    except ValueError as e:
        raise wrong(str(e)) from None
    return group, port, options
