"""A rig through its daemon: the control API (docs/api.md), with the words and codes of the terminal."""

from __future__ import annotations

import errno
import http.client
import json
import os
import socket
import struct
import tempfile
import time
from pathlib import Path
from typing import Any, Iterator, Optional
from urllib.parse import urlencode

from .errors import BadInput, DataLost, IsorigError, NoAnswer, NoDaemon, Refused, Tripped, located
from .recording import PathLike

#: A start compiles a protocol before it answers (s).
PATIENCE_S = 30.0
_STOP_CALLS = ("/v1/status", "/v1/abort", "/v1/pause")
_ATTEMPTS, _PAUSE_S = 5, 0.02


def default_socket() -> Path:
    """$ISORIG_SOCKET, else the service's when it is there, else the user's."""
    named = os.environ.get("ISORIG_SOCKET")
    if named:
        return Path(named)
    service = Path("/run/isorig/isorigd.sock")
    if service.exists():
        return service
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return Path(runtime) / "isorigd.sock"
    return Path(tempfile.gettempdir()) / f"isorigd-{os.environ.get('USER', 'user')}.sock"


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)


class _Connection(http.client.HTTPConnection):
    """HTTP over a Unix socket. A daemon that is stopped accepts nothing: connect() waits for SO_SNDTIMEO then."""

    def __init__(self, path: str, patience_s: float) -> None:
        super().__init__("localhost")
        self._path, self._patience_s = path, patience_s

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        whole = int(self._patience_s)
        limit = struct.pack("ll", whole, int((self._patience_s - whole) * 1e6))
        self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
        try:
            self.sock.connect(self._path)
        except BlockingIOError:
            raise socket.timeout("The socket was closed due to a timeout") from None
        self.sock.settimeout(self._patience_s)


class Rig:
    """The rig of the daemon that listens on `socket_path` (default_socket() if left out).

    Calls raise NoDaemon, NoAnswer, Refused or BadInput with the text that the terminal shows. Whoever may open the
    socket may move the rig: nothing here asks whether everybody is clear.
    """

    def __init__(self, socket_path: Optional[PathLike] = None, patience_s: float = PATIENCE_S) -> None:
        self.socket_path = Path(socket_path) if socket_path is not None else default_socket()
        self.patience_s = patience_s

    def get(self, path: str) -> Any:
        """The body of a GET call of docs/api.md."""
        return self._ask("GET", path, None)

    def post(self, path: str, body: "Optional[dict[str, Any]]" = None) -> Any:
        """The body of a POST call of docs/api.md."""
        return self._ask("POST", path, body or {})

    def _ask(self, method: str, path: str, body: "Optional[dict[str, Any]]") -> Any:
        where = str(self.socket_path)
        stops = where + ".stop"
        to = stops if path in _STOP_CALLS and os.path.exists(stops) else where
        problem: Optional[Exception] = None
        for attempt in range(_ATTEMPTS):
            if attempt:
                time.sleep(_PAUSE_S)
            connection = _Connection(to, self.patience_s)
            try:
                data = None if body is None else json.dumps(body).encode()
                connection.request(method, path, data, {"Content-Type": "application/json", "Connection": "close"})
                response = connection.getresponse()
                status, answer = response.status, response.read()
            except (http.client.RemoteDisconnected, ConnectionResetError, BrokenPipeError) as e:
                problem = e  # given up in a crowd before it was read: it did not happen, and may be tried again
                continue
            except (OSError, http.client.HTTPException) as e:
                raise _explained(where, e) from None
            finally:
                connection.close()
            if status != 503:
                return _answer(status, answer)
            problem = OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        raise NoDaemon(f"the daemon on {where} did not answer: {problem}")

    def status(self) -> Any:
        """State, step, progress, live values, overruns, clock bounds, link health, recorder."""
        return self.get("/v1/status")

    def plan(self) -> Any:
        """The rig's limits, and every step of the open run."""
        return self.get("/v1/plan")

    def events(self, after: int = 0) -> Any:
        """Events with a number above `after`."""
        return self.get("/v1/events?" + urlencode({"after": after}))["events"]

    def runs(self) -> Any:
        """The newest 500 runs, newest first."""
        return self.get("/v1/runs")["runs"]

    def readings(self, window_s: float = 2.0) -> Any:
        """Mean, scatter, drift and rate of every channel over the last 0.1 to 10 s."""
        return self.get("/v1/readings?" + urlencode({"window_s": window_s}))

    def start(self, protocol: PathLike, specimen: Optional[PathLike] = None, operator: str = "",
              dry_run: bool = False) -> str:
        """Starts a protocol file on the rig; the run's name. On a rig that has to be armed this is the first act, the
        name is "", and go() is the second. dry_run: nothing moves; raises what the start would raise."""
        body: "dict[str, Any]" = {"protocol": _config(protocol), "protocol_name": str(protocol), "operator": operator}
        if specimen is not None:
            body.update(specimen=_config(specimen), specimen_name=str(specimen))
        if dry_run:
            body["dry_run"] = True
        return str(self.post("/v1/start", body).get("run", ""))

    def go(self) -> str:
        """The second act: opens the armed run, or lets the paused one go on. What the daemon says."""
        return str(self.post("/v1/go").get("text", ""))

    def pause(self) -> str:
        """The frame stops and holds, the pressure is held, the plan waits."""
        return self._verb("pause")

    def resume(self, run: str = "", operator: str = "", resume_aborted: bool = False, on_another_rig: bool = False,
               another_specimen: bool = False) -> str:
        """A paused run goes on; with `run` one that was interrupted, from its interrupted repetition."""
        if not run:
            return self._verb("resume")
        return str(self.post("/v1/start", {
            "resume_run": run, "operator": operator, "resume_aborted": resume_aborted,
            "on_another_rig": on_another_rig, "another_specimen": another_specimen}).get("text", ""))

    def abort(self) -> str:
        """Ends the run: the frame stops, the pressure vents."""
        return self._verb("abort")

    def reset(self) -> str:
        """Clears a fault whose cause is gone."""
        return self._verb("reset")

    def confirm_zero(self) -> str:
        """The frame was started: you have looked at its zero, and positions are right."""
        return self._verb("confirm-zero")

    def _verb(self, name: str) -> str:
        return str(self.post("/v1/" + name).get("text", ""))

    def watch(self, run: str, interval_s: float = 0.5) -> Iterator[Any]:
        """The status, again and again, until `run` is over; the last is that of its end. Raises Tripped where it ended
        by a fault, DataLost where records were dropped, IsorigError where it was aborted or interrupted."""
        while True:
            status = self.status()
            opened = status.get("run", {}).get("id", "")
            if opened == run and status.get("state") != "faulted":
                yield status
                time.sleep(interval_s)
                continue
            if opened == run:
                yield status
                raise Tripped(f"run {run}: {_printable(status.get('fault', ''))}")
            last = status.get("last_run", {})
            outcome, fault = (last.get("outcome", ""), "") if last.get("id") == run else self._outcome(run)
            if outcome == "running":  # opened between the status and the list
                time.sleep(interval_s)
                continue
            yield status
            _judge(run, outcome, fault, status)
            return

    def _outcome(self, run: str) -> "tuple[str, str]":
        answer = self.get("/v1/runs")
        for each in answer["runs"]:
            if each.get("id") == run:
                return each.get("state", ""), each.get("fault", "")
        raise IsorigError(f"run {run} is not among the {len(answer['runs'])} newest of the {answer.get('all', 0)} runs "
                          f"that isorigd knows; isorig show {run} looks for an older one")

    def wait(self, run: str, interval_s: float = 0.5) -> Any:
        """Waits until `run` is over; the status then. Raises as watch() does."""
        status: Any = None
        for status in self.watch(run, interval_s):
            pass
        return status


def _judge(run: str, outcome: str, fault: str, status: Any) -> None:
    """As `isorig watch --until-done` ends: 6, 7, 1 or 0."""
    why = f"run {run}: {outcome}" + (f", {_printable(fault)}" if fault and outcome != "done" else "")
    if outcome == "failed":
        raise Tripped(why)
    if status.get("last_run", {}).get("id") == run and status.get("records_dropped", 0) > 0:
        raise DataLost(f"{why}, {status['records_dropped']} records dropped")
    if outcome != "done":
        raise IsorigError(why)


def _answer(status: int, answer: bytes) -> Any:
    try:
        body = json.loads(answer)
    except ValueError:
        body = {"text": "the daemon's answer is not JSON: " + answer.decode("utf-8", "replace")}
    if status == 200:
        return body
    text = _printable(str(body.get("text", ""))) if isinstance(body, dict) else ""
    raise BadInput(text) if status == 400 else Refused(text, status)


def _explained(where: str, error: Exception) -> NoDaemon:
    if isinstance(error, (socket.timeout, TimeoutError)):
        return NoAnswer(f"the daemon on {where} did not answer: The socket was closed due to a timeout")
    number = error.errno if isinstance(error, OSError) else None
    if number in (errno.ENOENT, errno.ECONNREFUSED):
        return NoDaemon(f"no daemon answers on {where}; start one: isorigd --rig RIG.toml (or name its socket: --socket)")
    if number in (errno.EACCES, errno.EPERM):
        return NoDaemon(f"you may not open {where}; ask to be added to its group")
    if number is None and isinstance(error, OSError):  # Python's own check of the path
        number = errno.ENAMETOOLONG
    return NoDaemon(f"cannot open {where}: {os.strerror(number) if number else error}")


def _config(file: PathLike) -> str:
    try:
        return Path(file).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise located(file, None, "no such file") from None
    except (OSError, UnicodeDecodeError) as e:
        raise located(file, None, e.strerror if isinstance(e, OSError) and e.strerror else str(e)) from None
