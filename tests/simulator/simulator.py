"""Counts again, from the documents alone, what `marti replay` printed of local memories.

    marti run TOPOLOGY --record references --out RUN
    marti replay RUN --local-memory all,1/8 --ways 1,full --format json > GRID.json
    python3 simulator.py RUN GRID.json

RUN is a folder of a run, its folder `recording`, or a trace: Dinero's text, classic or extended. Of a trace `--write-policy` and
`--write-allocate` follow GRID.json as they were given to marti, for its rows do not name them.

Each row of GRID.json names a setting and its counts. This program reads the references, computes the same counts and
compares them. It prints `N settings agree`, or which counts differ, and ends with 1 then. It is written to be read, and
shares no code with marti: docs/model.md, docs/topology.md and docs/recording.md say all that it does. Rows that are not
exact are refused: who traced which tile depends on simulated cycles there.
"""

import argparse
import json
import sys
from array import array
from collections import Counter, OrderedDict
from heapq import heappop, heappush
from pathlib import Path

import pyarrow as pa

SECTIONS = {"octree_nodes": 4, "leaf_lists": 4, "triangles": 40, "spheres": 16, "cones": 32, "surfaces": 8, "normals": 36,
            "materials": 48, "polygons": 8}
MASK_64, MASK_128 = 2**64 - 1, 2**128 - 1
READ, WRITE, COPY_BACK, INVALIDATE = "read", "write", "copy back", "invalidate"
NEVER = float("inf")


# Generators of rand_core 0.10 and rand_pcg 0.10

def seed_bytes(seed, length):
    """What `seed_from_u64` of rand_core makes of a seed: the output of a PCG XSH RR 64/32 that steps first."""
    words, state = [], seed
    for _ in range(length // 4):
        state = (state * 0x5851F42D4C957F2D + 0xA17654E46FBE17F3) & MASK_64
        words.append(xsh_rr(state))
    return array("I", words).tobytes()


def xsh_rr(state):
    value, turn = ((state >> 18 ^ state) >> 27) & 0xFFFFFFFF, state >> 59
    return (value >> turn | value << (-turn & 31)) & 0xFFFFFFFF


def pcg32(seed):
    """Numbers of 32 bits of `Pcg32`."""
    material = seed_bytes(seed, 16)
    increment = int.from_bytes(material[8:], "little") | 1
    state = (int.from_bytes(material[:8], "little") + increment) & MASK_64
    while True:
        state = (state * 0x5851F42D4C957F2D + increment) & MASK_64
        yield xsh_rr(state)


def pcg64(seed):
    """Numbers of 64 bits of `Pcg64`."""
    material = seed_bytes(seed, 32)
    increment = int.from_bytes(material[16:], "little") | 1
    state = (int.from_bytes(material[:16], "little") + increment) & MASK_128
    state = (state * 0x2360ED051FC65DA44385DF649FCCF645 + increment) & MASK_128
    while True:
        state = (state * 0x2360ED051FC65DA44385DF649FCCF645 + increment) & MASK_128
        value, turn = (state >> 64 ^ state) & MASK_64, state >> 122
        yield (value >> turn | value << (-turn & 63)) & MASK_64


# Replacement. A slot is set * ways + way. `hit`: its line was referenced; `victim`: a slot of a full set, in
# which a line is placed next; `fill`: it was placed; `drop`: its line was invalidated.

class Lru:
    def __init__(self, ways, _):
        self.ways, self.queues = ways, {}

    def hit(self, slot):
        self.queues[slot // self.ways].move_to_end(slot)

    def victim(self, place, line):
        return next(iter(self.queues[place]))

    def fill(self, slot, _):
        queue = self.queues.setdefault(slot // self.ways, OrderedDict())
        queue[slot] = None
        queue.move_to_end(slot)

    def drop(self, slot):
        del self.queues[slot // self.ways][slot]


class Fifo(Lru):
    def hit(self, slot):
        pass


class Clock:
    begins_referenced = True

    def __init__(self, ways, _):
        self.ways, self.hands, self.referenced = ways, Counter(), set()
        self.hit = self.referenced.add

    def victim(self, place, line):
        way = self.hands[place]
        while (slot := place * self.ways + way) in self.referenced:
            self.referenced.remove(slot)
            way = (way + 1) % self.ways
        self.hands[place] = (way + 1) % self.ways
        return slot

    def fill(self, slot, _):
        if self.begins_referenced:
            self.referenced.add(slot)
        else:
            self.referenced.discard(slot)

    def drop(self, slot):
        pass


class Clock0(Clock):
    begins_referenced = False


class Random:
    def __init__(self, ways, seed):
        self.ways, self.numbers = ways, pcg32(seed)

    def victim(self, place, line):
        return place * self.ways + (next(self.numbers) * self.ways >> 32)

    def hit(self, slot):
        pass

    def fill(self, slot, line):
        pass

    def drop(self, slot):
        pass


class Srrip:
    """Values of 2 bits: where none is 3 all of the set are raised until one is."""

    def __init__(self, ways, _):
        self.ways, self.values = ways, {}

    def hit(self, slot):
        self.values[slot // self.ways][slot % self.ways] = 0

    def victim(self, place, line):
        values = self.values[place]
        raised = 3 - max(values)
        if raised:
            values[:] = [value + raised for value in values]
        return place * self.ways + values.index(3)

    def fill(self, slot, _):
        values = self.values.setdefault(slot // self.ways, [])
        values[slot % self.ways:slot % self.ways + 1] = [2]

    def drop(self, slot):
        pass


class Sieve:
    """A queue from the oldest line to the newest. The hand stands before the line that it looks at next."""

    def __init__(self, ways, _):
        self.ways, self.sets, self.hits = ways, {}, set()
        self.hit = self.hits.add

    def victim(self, place, line):
        newer, hand = self.sets[place]["newer"], self.sets[place]["hand"]
        while True:
            slot = newer[hand]
            if slot is None:
                hand = None
            elif slot in self.hits:
                self.hits.remove(slot)
                hand = slot
            else:
                break
        newer[hand] = newer.pop(slot)
        if self.sets[place]["newest"] == slot:
            self.sets[place]["newest"], hand = hand, None
        self.sets[place]["hand"] = hand
        return slot

    def fill(self, slot, _):
        queue = self.sets.setdefault(slot // self.ways, {"newer": {None: None}, "newest": None, "hand": None})
        queue["newer"][queue["newest"]] = slot
        queue["newer"][slot], queue["newest"] = None, slot


class S3Fifo:
    """A small queue, a main queue and a ghost queue of lines that the small one evicted. Until the first eviction lines that
    the small queue has no room for go to the main one. What is moved to the main queue begins without hits; what is spared there
    loses one. The main queue evicts if it is too long or the small one is empty."""

    def __init__(self, ways, _):
        self.ways, self.sets, self.hits, self.lines = ways, {}, {}, {}
        self.small_size, self.ghost_size = max(1, ways // 10), ways * 9 // 10

    def hit(self, slot):
        self.hits[slot] = min(self.hits[slot] + 1, 3)

    def victim(self, place, line):
        queues = self.sets[place]
        small, main, ghost = queues["small"], queues["main"], queues["ghost"]
        queues["evicted"], queues["returns"] = True, line in ghost
        ghost.pop(line, None)
        if len(main) <= self.ways - self.small_size:
            while small:
                slot = small.popitem(last=False)[0]
                if self.hits[slot] < 2:
                    ghost[self.lines[slot]] = None
                    if len(ghost) > self.ghost_size:
                        ghost.popitem(last=False)
                    return slot
                main[slot], self.hits[slot] = None, 0
        while self.hits[slot := main.popitem(last=False)[0]]:
            main[slot] = None
            self.hits[slot] -= 1
        return slot

    def fill(self, slot, line):
        queues = self.sets.setdefault(slot // self.ways, {"small": OrderedDict(), "main": OrderedDict(),
                                                          "ghost": OrderedDict(), "evicted": False, "returns": False})
        full = not queues["evicted"] and len(queues["small"]) >= self.small_size
        queues["main" if queues["returns"] or full else "small"][slot] = None
        self.hits[slot], self.lines[slot] = 0, line


class Plru:
    """Node 1 is the root of the tree, nodes 2n and 2n + 1 are below node n; a set bit points to the second."""

    def __init__(self, ways, _):
        self.ways, self.trees = ways, {}

    def victim(self, place, line):
        node, tree = 1, self.trees[place]
        while node < self.ways:
            node = 2 * node + tree[node]
        return place * self.ways + node - self.ways

    def hit(self, slot):
        node, tree = slot % self.ways + self.ways, self.trees[slot // self.ways]
        while node > 1:
            tree[node // 2] = 1 - node % 2
            node //= 2

    def fill(self, slot, _):
        if slot // self.ways not in self.trees:
            self.trees[slot // self.ways] = [0] * self.ways
        self.hit(slot)

    def drop(self, slot):
        pass


class Optimal:
    """`following` has for each reference the place of the next one to the same line."""

    def __init__(self, ways, following):
        self.ways, self.following, self.next, self.queues = ways, iter(following), {}, {}

    def hit(self, slot):
        self.next[slot] = following = next(self.following)
        heappush(self.queues.setdefault(slot // self.ways, []), (-following, slot))

    def victim(self, place, line):
        queue = self.queues[place]
        while self.next[queue[0][1]] != -queue[0][0]:
            heappop(queue)
        return queue[0][1]

    def fill(self, slot, _):
        self.hit(slot)


def following(lines):
    """The place of the next reference to the same line, of each reference."""
    result, last = [NEVER] * len(lines), {}
    for place in range(len(lines) - 1, -1, -1):
        result[place] = last.get(lines[place], NEVER)
        last[lines[place]] = place
    return result


POLICIES = {"lru": Lru, "fifo": Fifo, "clock": Clock, "clock:0": Clock0, "random": Random, "srrip": Srrip, "sieve": Sieve,
            "s3-fifo": S3Fifo, "plru": Plru, "optimal": Optimal}


# Local memory

class Memory:
    def __init__(self, sets, ways, policy):
        self.sets, self.ways, self.policy = sets, ways, policy
        self.slots, self.lines, self.filled, self.dropped = {}, {}, Counter(), {}

    def place(self, line):
        """Places a line that is absent, and returns the one that was evicted or nothing."""
        place, evicted = line % self.sets, None
        if self.dropped.get(place):
            slot = heappop(self.dropped[place])
        elif self.filled[place] < self.ways:
            slot = place * self.ways + self.filled[place]
            self.filled[place] += 1
        else:
            slot = self.policy.victim(place, line)
            evicted = self.lines[slot]
            del self.slots[evicted]
        self.slots[line], self.lines[slot] = slot, line
        self.policy.fill(slot, line)
        return evicted

    def read(self, lines):
        """References the lines of a record, and returns how many were absent."""
        absent = 0
        for line in lines:
            slot = self.slots.get(line)
            if slot is None:
                self.place(line)
                absent += 1
            else:
                self.policy.hit(slot)
        return absent

    def drop(self, line):
        if (slot := self.slots.pop(line, None)) is not None:
            self.policy.drop(slot)
            heappush(self.dropped.setdefault(slot // self.ways, []), slot)


def divide(size, line, ways, extent):
    """Sets, and lines of a set, of a memory of such a size; `extent` is the number of lines that a share is taken of."""
    if size == "all":
        lines = max(extent, 16)
        return (-(-lines // ways), ways) if ways else (1, lines)
    if "/" in size:
        part, whole = size.split("/")
        lines = max(extent * int(part) // int(whole), 16)
    else:
        number, unit = size.split()
        lines = int(float(number) * 1024 ** ["B", "KiB", "MiB", "GiB", "TiB"].index(unit)) // line
    return (lines // ways, ways) if ways else (1, lines)


# Recordings

class Recording:
    def __init__(self, folder):
        self.sidecar = json.loads((folder / "references.json").read_text())
        run = self.sidecar["topology"].split("\n[run]\n")[1].splitlines()
        self.seed = next(int(line.split(" = ")[1]) for line in run if line.startswith("seed = "))
        self.records = []  # the first byte and the bytes of each record
        base = 0
        for section, size in SECTIONS.items():
            size = self.sidecar.get("record_bytes", SECTIONS).get(section, size)
            count = self.sidecar["records"].get(section, 0)
            self.records += [(base + index * size, size) for index in range(count)]
            base = -(-(base + count * size) // 256) * 256
        self.processes = [self.tiles(folder / file["name"]) for file in self.sidecar["files"]]
        self.streams = {}

    def tiles(self, path):
        """The tiles of a process in order: number, whether it counts, the records read."""
        with pa.ipc.open_stream(path) as stream:
            self.bytes = int(stream.schema.metadata[b"marti.image_bytes"])
            node, epoch = (int(stream.schema.metadata[key]) for key in (b"marti.node", b"marti.epoch"))
            lost = {(key["tile"], key["attempt"]) for key in self.sidecar["lost"] if (key["node"], key["epoch"]) == (node, epoch)}
            tiles, reads = [], []
            for batch in stream:
                tile, attempt, is_last = (batch[name][0].as_py() for name in ("tile", "attempt", "is_last"))
                reads += [word for word in batch["references"].flatten().to_pylist() if word < 2**30]
                if is_last:
                    tiles.append((tile, (tile, attempt) not in lost, reads))
                    reads = []
            return tiles

    def order(self, name):
        width, height, tile_width, tile_height = (
            self.sidecar["tiling"][key] for key in ("width", "height", "tile_width", "tile_height"))
        columns, rows = -(-width // tile_width), -(-height // tile_height)
        tiles = list(range(columns * rows))
        if name == "morton":
            tiles.sort(key=lambda tile: sum((tile % columns >> bit & 1) << 2 * bit | (tile // columns >> bit & 1) << 2 * bit + 1
                                            for bit in range(17)))
        if name == "random":
            numbers = pcg64(self.seed)
            for last in range(len(tiles) - 1, 0, -1):
                other = next(numbers) * (last + 1) >> 64
                tiles[last], tiles[other] = tiles[other], tiles[last]
        return tiles

    def assigned(self, row):
        """The tiles of each process that begins with an empty memory."""
        if row["assignment"] == "recorded":
            return self.processes
        counted = {tile[0]: tile for process in self.processes for tile in process if tile[1]}
        nodes = row["nodes"] * row["clusters"]
        tiles = [counted[tile] for tile in self.order(row["tile_order"])]
        return [tiles[node::nodes] for node in range(nodes)]

    def lines(self, row):
        """Of each process, whether a record read counts and its lines."""
        key = tuple(row[name] for name in ("line", "nodes", "clusters", "tile_order", "assignment"))
        if key not in self.streams:
            line = row["line"]
            lines = [range(first // line, (first + size - 1) // line + 1) for first, size in self.records]
            self.streams[key] = [[(counts, [lines[read] for read in reads]) for _, counts, reads in process]
                                 for process in self.assigned(row)]
        return self.streams[key]

    def counts(self, row):
        sets, ways = divide(row["local_memory"], row["line"], row["ways"], -(-self.bytes // row["line"]))
        accesses = misses = line_accesses = line_misses = words = 0
        for process in self.lines(row):
            if row["replacement"] == "optimal":
                policy = Optimal(ways, following([line for _, tile in process for lines in tile for line in lines]))
            else:
                policy = POLICIES[row["replacement"]](ways, self.seed)
            memory = Memory(sets, ways, policy)
            for counted, tile in process:
                absent = [memory.read(lines) for lines in tile]
                if counted:
                    accesses += len(tile)
                    line_accesses += sum(map(len, tile))
                    misses += len(absent) - absent.count(0)
                    line_misses += sum(absent)
        words = sum(self.records[read][1] // 4 for process in self.processes for _, counts, reads in process if counts
                    for read in reads)
        return {"local_bytes": sets * ways * row["line"], "sets": sets, "lines_per_set": ways, "record_accesses": accesses,
                "misses": misses, "line_accesses": line_accesses, "line_misses": line_misses, "words_read": words,
                "words_moved": line_misses * row["line"] // 4}


# Traces

class Trace:
    """Dinero's text. A classic line is of the aligned word of 4 bytes at its address; sizes of extended ones are hexadecimal."""

    CLASSIC = {"0": READ, "1": WRITE, "2": READ, "3": READ, "4": COPY_BACK, "5": INVALIDATE}
    EXTENDED = {"r": READ, "w": WRITE, "i": READ, "m": READ, "c": COPY_BACK, "v": INVALIDATE}

    def __init__(self, path, write_back, allocate):
        self.write_back, self.allocate, self.references = write_back, allocate, []
        for fields in map(str.split, path.read_text().splitlines()):
            if fields[0] in self.CLASSIC:
                self.references.append((self.CLASSIC[fields[0]], int(fields[1], 16) // 4 * 4, 4))
            else:
                self.references.append((self.EXTENDED[fields[0]], int(fields[1], 16), int(fields[2], 16)))

    def counts(self, row):
        size = row["line"]
        references = [(kind, first, count, range(first // size, (first + count - 1) // size + 1))
                      for kind, first, count in self.references]
        referenced = [line for kind, _, _, lines in references if kind in (READ, WRITE) for line in lines]
        marked = [lines[0] for kind, _, count, lines in references if kind in (COPY_BACK, INVALIDATE) and count]
        sets, ways = divide(row["local_memory"], size, row["ways"], len({*referenced, *marked}))
        policy = POLICIES[row["replacement"]](ways, following(referenced) if row["replacement"] == "optimal" else 1)
        memory, dirty, result, fetched = Memory(sets, ways, policy), set(), Counter(), 0
        for kind, first, count, lines in references:
            misses = result["line_misses"]
            if kind in (COPY_BACK, INVALIDATE):  # of the line at the address, of all lines where the size is 0
                lines = lines[:1] if count else list(memory.slots)
                result["bytes_written_back"] += size * (len(dirty.intersection(lines)) if kind == COPY_BACK else 0)
                dirty.difference_update(lines)
                if kind == INVALIDATE:
                    for line in lines:
                        memory.drop(line)
                continue
            for line in lines:
                absent = line not in memory.slots
                writes = kind == WRITE and row["replacement"] != "optimal"
                result.update(line_accesses=1, line_misses=absent, write_accesses=writes, write_misses=writes and absent)
                part = min(first + count, (line + 1) * size) - max(first, line * size)
                if not absent:
                    memory.policy.hit(memory.slots[line])
                elif not writes or self.allocate:
                    fetched += not writes or part < size
                    evicted = memory.place(line)
                    result["bytes_written_back"] += size * (evicted in dirty)
                    dirty.discard(evicted)
                if writes and self.write_back and line in memory.slots:
                    dirty.add(line)
                elif writes:
                    result["bytes_written_through"] += part
            result.update(record_accesses=1, misses=result["line_misses"] > misses, words_read=-(-count // 4))
        names = ["record_accesses", "misses", "line_accesses", "line_misses", "words_read", "write_accesses", "write_misses",
                 "bytes_written_back", "bytes_written_through"]
        return {"local_bytes": sets * ways * size, "sets": sets, "lines_per_set": ways, **{name: result[name] for name in names},
                "words_moved": fetched * size // 4, "bytes_dirty_at_end": len(dirty) * size}


def main():
    parser = argparse.ArgumentParser(description="Compute again what marti replay counted.")
    parser.add_argument("recording", type=Path, help="folder of a run, or a trace in Dinero's text")
    parser.add_argument("grid", type=Path, help="what `marti replay --format json` printed of it")
    parser.add_argument("--write-policy", choices=["back", "through"], default="back", help="as given to marti")
    parser.add_argument("--write-allocate", choices=["yes", "no"], default="yes", help="as given to marti")
    arguments = parser.parse_args()
    path = arguments.recording
    if path.is_dir():
        source = Recording(path / "recording" if (path / "recording").is_dir() else path)
    else:
        source = Trace(path, arguments.write_policy == "back", arguments.write_allocate == "yes")
    rows, faults = json.loads(arguments.grid.read_text()), 0
    for row in rows:
        setting = ", ".join(f"{name} {row[name]}" for name in list(row)[:list(row).index("bus_width")])
        if not row["exact"]:
            sys.exit(f"{setting}: the row is not exact: {row['reason']}")
        for name, value in source.counts(row).items():
            if row.get(name) not in (None, value):
                print(f"{setting}: {name} is {row[name]}, expected {value}", file=sys.stderr)
                faults += 1
    if faults or not rows:
        sys.exit(f"{faults} counts of {len(rows)} settings differ")
    print(f"{len(rows)} settings agree")


if __name__ == "__main__":
    main()
