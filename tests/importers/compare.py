"""Every OBJ file of Debian's assimp-testmodels and of PyPI's pybullet, as marti reads it and as trimesh does.

    python3 tests/importers/compare.py MARTI FOLDER...

Each file is rendered, and its bounds (to 1e-6 of the diagonal) and triangles are compared. What differs, or is refused, has to be
in the table below with its reason. Ends with 1 where a file is not as it should be, or is a reason for nothing.
"""

import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import charset_normalizer  # noqa: F401  Without it trimesh reads nothing but UTF-8, and that shows as files that it has nothing of.
import numpy
import trimesh

# By the end of a path: why marti refuses the file, though others make something of it.
REFUSED = {
    "invalid/malformed.obj": "a face names a vertex that is not there",
    "random_urdfs/168/168.obj": "faces use vertices whose coordinates are nan",
}
BOUNDS_TOLERANCE = 1e-6


def ours(marti, file, folder):
    """What is rendered and inspected, or why not."""
    run = lambda *arguments: subprocess.run([marti, *arguments], capture_output=True, text=True, errors="replace")
    done = run("render", file, "-q", "--size", "48x48", "-o", folder / "x.png")
    inspected = run("inspect", file, "--json") if done.returncode == 0 else done
    return (json.loads(inspected.stdout) if inspected.returncode == 0 else None), inspected


def theirs(file):
    """Lower and upper corner of all vertices that faces use, and the number of triangles; None without any."""
    try:
        scene = trimesh.load(file, process=False, force="scene", skip_materials=True)
    except ImportError:
        raise
    except Exception:  # Of any other kind: an importer that cannot read a file has nothing to compare.
        return None
    meshes = [mesh for mesh in scene.geometry.values() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    if not meshes:
        return None
    used = numpy.vstack([mesh.vertices[numpy.unique(mesh.faces)] for mesh in meshes])
    return used.min(0), used.max(0), sum(len(mesh.faces) for mesh in meshes)


def difference(inspection, expected):
    """What is not the same, or None."""
    bounds, triangles = inspection.get("bounds"), inspection["primitives"]
    if expected is None:
        return f"{triangles} triangles, expected none" if triangles else None
    low, high, count = expected
    if bounds is None:
        return f"nothing, expected {count} triangles"
    off = max(numpy.abs(numpy.subtract(bounds["low"], low)).max(), numpy.abs(numpy.subtract(bounds["high"], high)).max())
    if off > BOUNDS_TOLERANCE * numpy.linalg.norm(high - low):
        return f"bounds {bounds}, expected {low} to {high}"
    return None if triangles == count else f"{triangles} triangles, expected {count}"


def main(marti, *roots):
    warnings.filterwarnings("ignore")
    for root in roots:
        if not Path(root).is_dir():
            print(f"SKIPPED: there is no folder {root}", file=sys.stderr)
    files = sorted(file for root in roots for file in Path(root).rglob("*") if file.suffix.lower() == ".obj")
    faults, refused, equal = [], set(), 0
    with tempfile.TemporaryDirectory() as folder:
        for file in files:
            reason = next((end for end in REFUSED if str(file).endswith(end)), None)
            inspection, done = ours(marti, file, Path(folder))
            if inspection is None and done.returncode == 2 and reason:
                refused.add(reason)
            elif inspection is None:
                faults.append(f"{file}: exit code {done.returncode}: {done.stderr.strip()}")
            elif reason:
                faults.append(f"{file}: is rendered, expected that it is refused: {REFUSED[reason]}")
            elif what := difference(inspection, theirs(file)):
                faults.append(f"{file}: {what}")
            else:
                equal += 1
    for fault in faults:
        print(fault)
    for end in sorted(refused):
        print(f"{end} is refused: {REFUSED[end]}")
    print(f"{len(files)} files: {equal} equal, {len(refused)} refused for their reasons, {len(faults)} faults")
    return 1 if faults or not files else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
