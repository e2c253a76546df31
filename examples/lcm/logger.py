#!/usr/bin/python3
"""Writes what a rig publishes to an LCM log, as lcm-logger does, and says what was missed.

    ./logger.py [--lcm-url URL] FILE       until Ctrl-C; then `isorig export FILE ...` or lcm-logplayer FILE

Needs the types alone (package python3-isorig, or `lcm-gen -p messages/lcm/*.lcm`): Debian 12 has no LCM for Python, and
receiving is 30 lines. LCM drops in silence. Every message of a rig begins with its number, which counts its channel's
messages from 0: a jump is what was missed, a step back of at most 64 is a message that the network delivered late, a
larger one is a new daemon.
"""

import argparse
import signal
import socket
import struct
import time
import urllib.parse

from isorig_msgs import frame_batch_t

SHORT_MESSAGE = 0x4C433032  # "LC02"; a rig publishes nothing that needs LCM's fragments
LOG_SYNC = 0xEDA1DA01


def subscribe(url):
    """A socket that hears udpm://GROUP:PORT?ttl=..&recv_buf_size=.."""
    parts = urllib.parse.urlparse(url)
    options = dict(urllib.parse.parse_qsl(parts.query))
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM, socket.IPPROTO_UDP)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, int(options.get("recv_buf_size", 4194304)))
    s.bind((parts.hostname, parts.port))
    membership = socket.inet_aton(parts.hostname) + socket.inet_aton("0.0.0.0")
    s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    s.settimeout(0.1)
    return s


def message(packet):
    """(channel, data) of a datagram; None of what is no short message of LCM's."""
    if len(packet) < 8 or struct.unpack_from(">I", packet)[0] != SHORT_MESSAGE:
        return None
    channel, zero, data = packet[8:].partition(b"\0")
    return (channel.decode(), data) if zero else None


class Count:
    """Of one channel."""

    MOST_LATE = 64

    def __init__(self):
        self.messages = self.missed = 0
        self.newest = None  # number; before it, `gaps` has those that did not come
        self.gaps = set()
        self.zero_came_again = False

    def next(self, number):
        """What this message changes `missed` by: how many were skipped before it, -1 for one that comes late."""
        if number < 0:
            return 0  # no rig's
        again, self.zero_came_again = self.zero_came_again, False
        if self.newest is None:
            self.newest = number
        if self.newest - number > self.MOST_LATE:  # a new daemon, of which the first were missed
            self.newest, self.gaps = -1, set()
        elif again and 0 < number <= self.newest:  # a new daemon, before the old one had sent 64
            self.newest, self.gaps = 0, set()
        if number > self.newest:
            skipped = number - self.newest - 1
            oldest = number - self.MOST_LATE
            self.gaps.update(range(max(self.newest + 1, oldest), number))
            self.gaps = {each for each in self.gaps if each >= oldest}
            self.newest = number
            return skipped
        if number in self.gaps:
            self.gaps.remove(number)
            return -1
        self.zero_came_again = number == 0  # a daemon's first, or a repeat: the next one tells
        return 0


class Logger:
    def __init__(self, file):
        self.file = file
        self.events = 0
        self.samples = 0
        self.counts = {}  # by channel

    def take(self, channel, data):
        head = struct.pack(">IqqII", LOG_SYNC, self.events, time.time_ns() // 1000, len(channel), len(data))
        self.file.write(head + channel.encode() + data)
        self.events += 1
        if len(data) < 16:
            return
        number = struct.unpack_from(">q", data, 8)[0]  # of any type: 8 bytes say which, then comes `number`
        count = self.counts.setdefault(channel, Count())
        change = count.next(number)
        if change > 0:
            print(f"{channel}: missed {change}", flush=True)
        count.messages += 1
        count.missed += change
        if channel == "ISORIG_FRAME":  # and decoded, as any program that wants the numbers does
            self.samples += frame_batch_t.decode(data).count


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--lcm-url", default="udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304")
    parser.add_argument("file")
    arguments = parser.parse_args()
    ended = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(True))
    with subscribe(arguments.lcm_url) as receiver, open(arguments.file, "wb") as file:
        logger = Logger(file)
        print("listening", flush=True)
        while not ended:
            try:
                heard = message(receiver.recv(65536))
            except socket.timeout:
                continue
            if heard and heard[0].startswith("ISORIG_"):
                logger.take(*heard)
    for channel, count in sorted(logger.counts.items()):
        print(f"{channel}: {count.messages} messages, {count.missed} missed")
    print(f"{logger.samples} frame samples")


if __name__ == "__main__":
    main()
