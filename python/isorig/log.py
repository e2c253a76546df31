"""LCM event logs: the segments of a run, and what `lcm-logger` writes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterable, Iterator

import isorig_msgs

from ._native import crc32c
from .errors import located
from .recording import PathLike

_SYNC = b"\xed\xa1\xda\x01"
_HEADER = struct.Struct(">4sqqii")
_FIRST_EVENTS = 64  # that are asked for checksums, as by isorig itself
_FORMAT = b"isorig-log/2"

#: Which type a channel has (docs/lcm-channels.md).
TYPES: "dict[str, Any]" = {
    "ISORIG_HEADER": isorig_msgs.run_header_t, "ISORIG_SESSION": isorig_msgs.session_mark_t,
    "ISORIG_FRAME": isorig_msgs.frame_batch_t, "ISORIG_PRESSURE": isorig_msgs.pressure_batch_t,
    "ISORIG_FRAME_AVERAGE": isorig_msgs.frame_average_batch_t,
    "ISORIG_PRESSURE_AVERAGE": isorig_msgs.pressure_average_batch_t,
    "ISORIG_STATE": isorig_msgs.control_batch_t, "ISORIG_EVENT": isorig_msgs.event_t,
    "ISORIG_PROGRESS": isorig_msgs.progress_t, "ISORIG_CLOCK": isorig_msgs.exchange_batch_t,
    "ISORIG_SYNC": isorig_msgs.sync_check_t, "ISORIG_CHAIN": isorig_msgs.chain_t,
}


@dataclass(frozen=True)
class LogEvent:
    """number: of the event in its log. utime_us: Unix time (us). data: of the message, without isorig's checksum."""

    number: int
    utime_us: int
    channel: str
    data: bytes

    def decode(self) -> Any:
        """The message, as the class of `isorig_msgs` that its channel has. Raises ValueError when it is none."""
        if self.channel not in TYPES:
            raise ValueError(f"{self.channel}: not a channel of isorig; it has {', '.join(TYPES)}")
        try:
            return TYPES[self.channel].decode(self.data)
        except struct.error as e:
            raise ValueError(f"{self.channel}: the message is cut: {e}") from None


def read_log(file: PathLike) -> Iterator[LogEvent]:
    """Every whole event of a log, in order. Bytes that are no event, or whose checksum does not fit, are passed over:
    `Run.complaints` says what is wrong with a recording."""
    data = _content(file)
    return _whole_events(data, _has_checksums(data))


def read_segments(files: Iterable[PathLike]) -> Iterator[LogEvent]:
    """The same of a run's segments, from the first one on. One without a message whose checksum is right has checksums
    nevertheless behind one that has them, and where it is the first and does not say that it is of format 1 (docs/data.md)."""
    checked: "bool | None" = None
    for file in files:
        data = _content(file)
        if not checked:
            checked = _has_checksums(data) or (checked is None and data != b"" and not _says_that_it_has_none(data))
        yield from _whole_events(data, checked)


def _content(file: PathLike) -> bytes:
    try:
        return Path(file).read_bytes()
    except OSError as e:
        raise located(Path(file), None, e.strerror or str(e)) from None


def _whole_events(data: bytes, checked: bool) -> Iterator[LogEvent]:
    offset = 0
    while offset < len(data):
        found = _event_at(data, offset)
        if found is None or (checked and not found[1]):
            offset = data.find(_SYNC, offset + 1)
            if offset < 0:
                return
            continue
        event, _, offset = found
        yield LogEvent(event.number, event.utime_us, event.channel, event.data[:-4] if checked else event.data)


def _has_checksums(data: bytes) -> bool:
    """One right checksum among the first events is enough; what is damaged between them is passed over."""
    offset = data.find(_SYNC)
    for _ in range(_FIRST_EVENTS):
        if offset < 0:
            return False
        found = _event_at(data, offset)
        if found is not None and found[1]:
            return True
        offset = data.find(_SYNC, offset + 1)
    return False


def _says_that_it_has_none(data: bytes) -> bool:
    """The header's text comes first in its message, behind eight bytes of fingerprint and the text's length."""
    found = _event_at(data, 0)
    if found is None or found[0].channel != "ISORIG_HEADER":
        return False
    message = found[0].data
    length = int.from_bytes(message[8:12], "big")
    return 0 < length <= len(message) - 12 and message[12:11 + length] != _FORMAT


def _event_at(data: bytes, offset: int) -> "tuple[LogEvent, bool, int] | None":
    """The event that begins there, with whether its checksum fits, and where it ends."""
    if offset + _HEADER.size > len(data):
        return None
    sync, number, utime_us, channel_bytes, data_bytes = _HEADER.unpack_from(data, offset)
    end = offset + _HEADER.size + channel_bytes + data_bytes
    if sync != _SYNC or channel_bytes < 1 or data_bytes < 0 or end > len(data):
        return None
    at = offset + _HEADER.size
    good = data_bytes >= 4 and crc32c(data[offset:end - 4]) == int.from_bytes(data[end - 4:end], "big")
    channel = data[at:at + channel_bytes].decode("ascii", "replace")
    return LogEvent(number, utime_us, channel, data[at + channel_bytes:end]), good, end
