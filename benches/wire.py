#!/usr/bin/env python3
"""A wire between two network namespaces: a TAP device in each, every frame is handed over after a fixed delay and not
before the frames ahead of it have left at the given rate. For kernels without netem.

wire.py NAMESPACE NAMESPACE DELAY_SECONDS BITS_PER_SECOND; prints "ready" when both devices (eth0) are there."""
import collections
import fcntl
import os
import select
import struct
import subprocess
import sys
import time

namespaces, delay, rate = sys.argv[1:3], float(sys.argv[3]), float(sys.argv[4])
ends = []
for i, namespace in enumerate(namespaces):
    end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    name = f"wire{os.getpid()}{i}"
    # TUNSETIFF with IFF_TAP | IFF_NO_PI.
    fcntl.ioctl(end, 0x400454CA, struct.pack("16sH", name.encode(), 0x1002))
    subprocess.run(["ip", "link", "set", name, "netns", namespace], check=True)
    subprocess.run(["ip", "-n", namespace, "link", "set", name, "name", "eth0", "mtu", "9000"], check=True)
    ends.append(end)
print("ready", flush=True)

poll = select.poll()
for end in ends:
    poll.register(end, select.POLLIN)
under_way = {end: collections.deque() for end in ends}
free = dict.fromkeys(ends, 0.0)
while True:
    due = min((queue[0][0] for queue in under_way.values() if queue), default=None)
    now = time.monotonic()
    # Below a millisecond poll cannot wait: look again at once.
    poll.poll(200 if due is None else 0)
    for end, other in (ends, ends[::-1]):
        for _ in range(64):
            try:
                frame = os.read(end, 65536)
            except BlockingIOError:
                break
            now = time.monotonic()
            free[end] = max(free[end], now) + 8 * len(frame) / rate
            under_way[end].append((free[end] + delay, frame))
        queue = under_way[end]
        while queue and queue[0][0] <= time.monotonic():
            try:
                os.write(other, queue.popleft()[1])
            except (BlockingIOError, OSError):
                pass
