"""A daemon in real time on the simulated rig: runs started, watched and stopped, and its live samples.

As root in a network of its own, so that its multicast meets nobody else's.
"""

import ctypes
import os
import re
import runpy
import socket
import struct
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

from isorig import BadInput, GapCounter, IsorigError, Live, NoAnswer, NoDaemon, Refused, Rig
from isorig_msgs import event_t, frame_batch_t
from made import BIN, SOURCE

PORT = 7667
PROTOCOL = """format = "isorig-protocol/1"
name = "short"
recording.policy = "full"
steps = [
  { do = "pressurize", pressure_psi = 2, rate_psi_s = 5, settled_for_s = 0.2, timeout_s = 20 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
  { do = "hold", duration_s = 1.5 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 10 },
]
"""


def own_network() -> bool:
    """Only the loopback, with multicast."""
    if os.geteuid() != 0 or ctypes.CDLL(None, use_errno=True).unshare(0x40000000) != 0:  # CLONE_NEWNET
        return False
    for words in ("link set lo up multicast on", "route add 224.0.0.0/4 dev lo"):
        subprocess.run(["ip", *words.split()], check=True)
    return True


class OnARig(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.multicast = own_network()
        cls.folder = Path(tempfile.mkdtemp())
        rig = (SOURCE / "config/rigs/sim.toml").read_text()
        enabled = "true" if cls.multicast else "false"
        rig = re.sub(r"\[lcm\]\nenabled = \w+", f"[lcm]\nenabled = {enabled}", rig)
        for name in ("specimens", "frames", "regulators"):
            os.symlink(SOURCE / "config" / name, cls.folder / name)
        (cls.folder / "rigs").mkdir()
        (cls.folder / "rigs/rig.toml").write_text(rig)
        (cls.folder / "short.toml").write_text(PROTOCOL)
        cls.socket = cls.folder / "s"
        with open(cls.folder / "log", "w") as log:
            cls.daemon = subprocess.Popen([BIN / "isorigd", "--no-realtime", "--rig", cls.folder / "rigs/rig.toml", "--runs",
                                           cls.folder / "runs", "--socket", cls.socket], stdout=log, stderr=log)
        cls.rig = Rig(cls.socket)
        until = time.monotonic() + 20
        while True:
            try:
                if cls.rig.status()["state"] == "ready":
                    return
            except NoDaemon:
                pass
            if time.monotonic() > until or cls.daemon.poll() is not None:
                raise AssertionError((cls.folder / "log").read_text())
            time.sleep(0.05)

    @classmethod
    def tearDownClass(cls) -> None:
        cls.daemon.terminate()
        cls.daemon.wait(20)

    def terminal(self, *words: object) -> "tuple[int, str]":
        done = subprocess.run([BIN / "isorig", *map(str, words), "--socket", self.socket], capture_output=True, text=True, timeout=60)
        return done.returncode, (done.stdout + done.stderr).strip()

    def test_a_run_is_started_watched_and_done(self) -> None:
        run = self.rig.start(self.folder / "short.toml", operator="Ada")
        states = [status["state"] for status in self.rig.watch(run, interval_s=0.05)]
        self.assertIn("running", states)
        self.assertEqual(states[-1], "ready")
        there = self.rig.runs()[0]
        self.assertEqual((there["id"], there["state"], there["operator"]), (run, "done", "Ada"))
        self.assertIn("step", [event["code"] for event in self.rig.events()])

    def test_a_run_is_stopped(self) -> None:
        run = self.rig.start(self.folder / "short.toml")
        self.rig.pause()
        self.rig.resume()
        self.rig.abort()
        with self.assertRaises(IsorigError) as caught:
            self.rig.wait(run, interval_s=0.05)
        self.assertEqual((caught.exception.exit_code, str(caught.exception)), (1, f"run {run}: aborted"))
        until = time.monotonic() + 20
        while self.rig.status()["state"] != "ready" and time.monotonic() < until:
            time.sleep(0.05)

    def test_refusals_are_the_terminals(self) -> None:
        (self.folder / "wrong.toml").write_text(PROTOCOL.replace("velocity_mm_s = 10", "velocity_mm_s = 1e9"))
        for call, words in [(self.rig.pause, ["pause"]), (self.rig.resume, ["resume"]), (self.rig.reset, ["reset"]),
                            (lambda: self.rig.start(self.folder / "wrong.toml"), ["start", self.folder / "wrong.toml"]),
                            (lambda: self.rig.resume("nothing"), ["resume", "nothing"])]:
            code, said = self.terminal(*words)
            if code == 0:
                continue  # reset of a healthy rig
            with self.assertRaises((Refused, BadInput)) as caught:
                call()
            self.assertEqual((caught.exception.exit_code, str(caught.exception)), (code, said), words)

    def test_nobody_there_is_said_as_at_the_terminal(self) -> None:
        nobody = self.folder / "nobody"
        long = self.folder / ("x" * 120)
        for path in (nobody, long):
            done = subprocess.run([BIN / "isorig", "pause", "--socket", path], capture_output=True, text=True)
            with self.assertRaises(NoDaemon) as caught:
                Rig(path).pause()
            self.assertEqual((4, "isorig: " + str(caught.exception)), (done.returncode, done.stderr.strip()))

    def test_a_silent_daemon_is_no_answer(self) -> None:
        path = self.folder / "silent"
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(str(path))
            listener.listen(0)
            with self.assertRaises(NoAnswer):
                Rig(path, patience_s=0.1).status()
            fill = [socket.socket(socket.AF_UNIX) for _ in range(3)]
            for each in fill:  # and one whose queue is full
                each.setblocking(False)
                each.connect_ex(str(path))
            with self.assertRaises(NoAnswer):
                Rig(path, patience_s=0.1).status()
            for each in fill:
                each.close()

    def test_live_samples_come_all(self) -> None:
        if not self.multicast:
            self.skipTest("needs a network of its own: run as root")
        with Live() as live:
            started, seen = time.monotonic(), []
            while time.monotonic() - started < 1.5:
                message = live.receive(timeout_s=1.0)
                if message is not None and message.channel == "ISORIG_FRAME":
                    seen.append(message.data)
            samples = [m.sequence + k for m in seen for k in m.sequence_offset]
            self.assertGreater(len(samples), 1000)
            self.assertEqual(samples, list(range(samples[0], samples[0] + len(samples))))
            self.assertEqual((live.dropped["ISORIG_FRAME"], live.foreign), (0, 0))
            self.assertIn("ISORIG_STATE", live.received)

    def test_what_a_slow_subscriber_missed_is_counted(self) -> None:
        if not self.multicast:
            self.skipTest("needs a network of its own: run as root")
        with Live("udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4096", ("ISORIG_FRAME",)) as slow, Live() as quick:
            first = slow.receive(2.0)
            numbers = []
            until = time.monotonic() + 1.0
            while time.monotonic() < until:
                message = quick.receive(0.1)
                if message is not None and message.channel == "ISORIG_FRAME":
                    numbers.append(message.data.number)
            last = first
            while last.data.number < numbers[-1] + 5:
                last = slow.receive(2.0)
            self.assertGreater(slow.dropped["ISORIG_FRAME"], 10)
            self.assertEqual(slow.received["ISORIG_FRAME"] + slow.dropped["ISORIG_FRAME"], last.data.number - first.data.number + 1)

    def test_strangers_are_counted_and_passed_over(self) -> None:
        if not self.multicast:
            self.skipTest("needs a network of its own: run as root")
        with Live("udpm://239.255.76.67:7999?ttl=0") as live, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            head = struct.pack(">II", 0x4C433032, 0)
            event = event_t()
            event.number = 3
            for packet in (b"", b"x" * 50, head + b"OTHER\0abc", head + b"ISORIG_EVENT\0cut", head + b"ISORIG_EVENT\0" + frame_batch_t().encode(),
                           head + b"ISORIG_EVENT\0" + event.encode()):
                sender.sendto(packet, ("239.255.76.67", 7999))
            message = live.receive(2.0)
            self.assertEqual((message.channel, message.data.number, live.foreign), ("ISORIG_EVENT", 3, 5))
            self.assertIsNone(live.receive(0.05))


class Subscribing(unittest.TestCase):
    def test_wrong_urls_are_refused(self) -> None:
        for url in ("tcpq://localhost", "udpm://127.0.0.1:7667", "udpm://239.255.76.67:99999", "udpm://239.255.76.67:7667?recv_buf_size=x"):
            with self.assertRaises(BadInput) as caught:
                Live(url)
            self.assertIn("an LCM URL is like udpm://", str(caught.exception))
        with self.assertRaises(BadInput):
            Live(channels=("ISORIG_FORCE",))

    def test_gaps_are_counted_as_in_cpp(self) -> None:
        cases = [line.split("=") for line in (SOURCE / "tests/messages/gap_cases.txt").read_text().splitlines() if line[0] != "#"]
        self.assertGreater(len(cases), 15)
        logger = runpy.run_path(str(SOURCE / "examples/lcm/logger.py"))
        for numbers, changes in cases:
            for counter in (GapCounter(), logger["Count"]()):
                self.assertEqual([counter.next(int(n)) for n in numbers.split()], [int(n) for n in changes.split()], numbers)


if __name__ == "__main__":
    unittest.main()
