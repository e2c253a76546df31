"""LCM event logs: the segments of a run, and what `lcm-logger` writes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterator

import isorig_msgs

from ._native import crc32c
from .errors import located
from .recording import PathLike

_SYNC = b"\xed\xa1\xda\x01"
_HEADER = struct.Struct(">4sqqii")

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
    file = Path(file)
    try:
        data = file.read_bytes()
    except OSError as e:
        raise located(file, None, e.strerror or str(e)) from None
    events = list(_events(data, 0, 64))
    checked = any(good for _, good, _ in events)
    offset = 0
    while offset < len(data):
        found = next(_events(data, offset, 1), None)
        if found is None or (checked and not found[1]):
            offset = data.find(_SYNC, offset + 1)
            if offset < 0:
                return
            continue
        event, _, offset = found
        yield LogEvent(event.number, event.utime_us, event.channel, event.data[:-4] if checked else event.data)


def _events(data: bytes, offset: int, most: int) -> Iterator["tuple[LogEvent, bool, int]"]:
    """Events that follow each other from `offset` on: with whether the checksum fits, and where they end."""
    for _ in range(most):
        if offset + _HEADER.size > len(data):
            return
        sync, number, utime_us, channel_bytes, data_bytes = _HEADER.unpack_from(data, offset)
        end = offset + _HEADER.size + channel_bytes + data_bytes
        if sync != _SYNC or channel_bytes < 1 or data_bytes < 0 or end > len(data):
            return
        at = offset + _HEADER.size
        good = data_bytes >= 4 and crc32c(data[offset:end - 4]) == int.from_bytes(data[end - 4:end], "big")
        channel = data[at:at + channel_bytes].decode("ascii", "replace")
        yield LogEvent(number, utime_us, channel, data[at + channel_bytes:end]), good, end
        offset = end
