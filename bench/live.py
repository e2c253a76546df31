"""Rows of bench/run that look at a running daemon: on the simulated rig, with its own LCM group and folder."""
from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from measure import TREE, Figure, NotMeasured, needs, objects, run, steal_share

if TYPE_CHECKING:
    from rows import Bench

URL = "udpm://239.255.76.69:7669?ttl=0"
LISTEN = URL + "&recv_buf_size=4194304"
LOOP_PRIORITY = 80  # docs/threads.md


@contextlib.contextmanager
def daemon(bench: Bench, *options: str, rate_hz: int = 1000, period_ms: int = 10) -> Iterator[subprocess.Popen[str]]:
    """The daemon on a copy of the simulated rig, vented and at rest; ends with SIGTERM."""
    with tempfile.TemporaryDirectory() as folder:
        rig = (TREE / "config/rigs/sim.toml").read_text().replace("../specimens", str(TREE / "config/specimens"))
        rig = rig.replace("[sim.frame]", f"[sim.frame]\nsample_rate_hz = {rate_hz}")
        rig, replaced = re.subn(r"^\[lcm\]\nenabled = false$", f'[lcm]\nurl = "{URL}"\nperiod_ms = {period_ms}', rig, flags=re.MULTILINE)
        if replaced != 1:
            raise NotMeasured("config/rigs/sim.toml no longer has `[lcm]` with `enabled = false`, which this row replaces")
        (Path(folder) / "rig.toml").write_text(rig)
        process = subprocess.Popen([bench.bin / "isorigd", "--rig", f"{folder}/rig.toml", "--runs", f"{folder}/runs",
                                    "--socket", f"{folder}/socket", *options], text=True, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.PIPE)
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            _, said = process.communicate(timeout=30)
            if process.returncode not in (0, -signal.SIGTERM):
                raise NotMeasured(f"isorigd ended with {process.returncode}: {said.strip()[-400:]}")


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rest(bench: Bench) -> list[Figure]:
    shares, megabytes, firsts = [], [], []
    for _ in range(3):
        begin_ns = time.monotonic_ns()
        with daemon(bench, "--no-realtime") as process:
            told = objects(run(bench.bin / "bench_lcm_age", "daemon", LISTEN, 5).out)[0]
            firsts.append((told["first_mono_ns"] - begin_ns) / 1e9)
            used, at = cpu_s(process.pid), time.monotonic()
            time.sleep(15.0)
            shares.append(100.0 * (cpu_s(process.pid) - used) / (time.monotonic() - at))
            pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
            megabytes.append(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)
    return [Figure("processor", "% of a core", shares, target="< 5 %", met=max(shares) < 5.0),
            Figure("resident memory", "MB", megabytes, target="< 50 MB", met=max(megabytes) < 50.0),
            Figure("from start to the first sample at a subscriber", "s", firsts, target="< 1 s", met=max(firsts) < 1.0)]


def lcm(bench: Bench) -> list[Figure]:
    figures = []
    for rate_hz, period_ms in ((1000, 10), (1000, 1), (5000, 1)):
        ours, pair, missed = [], [], 0
        for _ in range(bench.repeat):
            with daemon(bench, "--no-realtime", rate_hz=rate_hz, period_ms=period_ms):
                time.sleep(2.0)
                told = objects(run(bench.bin / "bench_lcm_age", "daemon", LISTEN, 8).out)[0]
            ours.append(told["p99_ms"])
            missed += told["missed_messages"]
            pair.append(objects(run(bench.bin / "bench_lcm_age", "pair", LISTEN, 8, rate_hz).out)[0]["p99_ms"])
        ratios = sorted(a / b for a, b in zip(ours, pair))
        figures.append(Figure(f"device stamp to subscriber at {rate_hz} Hz, `period_ms = {period_ms}`, 99 %", "ms", ours, "bare LCM pair, a message a sample",
                              pair, "< 1.5 times", ratios[len(ratios) // 2] < 1.5, f"{missed} messages missed"))
    return figures


def logger_ns(bench: Bench, folder: Path, rate_hz: int = 5000, seconds: int = 5) -> float:
    """CPU time that lcm-logger takes for a message of one sample, disk included [ns]."""
    log = folder / "peer.lcmlog"
    log.unlink(missing_ok=True)
    logger = subprocess.Popen([needs("lcm-logger", "liblcm-bin"), "-q", f"--lcm-url={LISTEN}", str(log)],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        time.sleep(0.5)
        before = cpu_s(logger.pid)
        told = objects(run(bench.bin / "bench_lcm_age", "pair", LISTEN, seconds, rate_hz).out)[0]
        return (cpu_s(logger.pid) - before) * 1e9 / float(told["samples"])
    finally:
        logger.terminate()
        logger.wait()
        log.unlink(missing_ok=True)


def wakeup(bench: Bench) -> list[Figure]:
    """Windows of 10 s in which the hypervisor stole less than 0.5 %; both threads on any processor, same priority."""
    if os.geteuid() != 0:
        raise NotMeasured("needs root, for real-time rights of the daemon and of cyclictest: sudo bench/run wakeup")
    cyclictest, stress = needs("cyclictest", "rt-tests"), needs("stress-ng", "stress-ng")
    ours, peer, refused = [], [], 0
    with tempfile.TemporaryDirectory() as folder, daemon(bench) as process:
        load = subprocess.Popen([stress, "--cpu", "2", "--hdd", "1", "--hdd-bytes", "64M", "--temp-path", folder, "--quiet"])
        try:
            time.sleep(3.0)
            for _ in range(4 * bench.repeat):
                if process.poll() is not None:
                    break
                stolen, whole = steal_share()
                other = subprocess.Popen([cyclictest, "-m", "-q", "-t1", f"-p{LOOP_PRIORITY}", "-i1000", "-D10", "-h100000"],
                                         text=True, stdout=subprocess.PIPE)
                told = objects(run(bench.bin / "bench_lcm_age", "wakeups", LISTEN, 10).out)[0]
                out, _ = other.communicate()
                stolen_after, whole_after = steal_share()
                if (stolen_after - stolen) / (whole_after - whole) > 0.005:
                    refused += 1
                    continue
                ours.append(told["p999_us"])
                peer.append(quantile_of_histogram(out, 0.999))
                if len(ours) == bench.repeat:
                    break
        finally:
            load.terminate()
            load.wait()
    if not ours:
        raise NotMeasured(f"all {refused} windows had more than 0.5 % of the processor stolen by the hypervisor")
    ratios = sorted(a / b for a, b in zip(ours, peer))
    return [Figure("wake-up later than planned, 99.9 %", "µs", ours, "cyclictest", peer, "at most 1.2 times",
                   ratios[len(ratios) // 2] <= 1.2, f"{refused} windows left out for stolen processor time")]


def quantile_of_histogram(text: str, share: float) -> float:
    """Of cyclictest -h: lines `microseconds count`, then how many lay beyond."""
    counts = [(int(a), int(b)) for a, b in re.findall(r"^(\d+) (\d+)$", text, re.MULTILINE)]
    beyond = int(m[1]) if (m := re.search(r"# Histogram Overflows: (\d+)", text)) else 0
    wanted, seen = share * (sum(n for _, n in counts) + beyond), 0
    for microseconds, n in counts:
        seen += n
        if seen >= wanted:
            return float(microseconds)
    raise NotMeasured("more than one wake-up of cyclictest in a thousand came beyond its histogram of 100 ms")
