# What CI runs: `just check`.
default: check

check: fmt clippy test doc deny unused typos

fmt:
    cargo fmt --check
    cargo fmt --manifest-path fuzz/Cargo.toml --check

clippy:
    cargo clippy --all-targets --features evil -- -D warnings
    cargo clippy --all-targets --features exr -- -D warnings
    cargo clippy --manifest-path fuzz/Cargo.toml --target-dir target -- -D warnings

# The README's second command. The feature is for the hostile node of tests/evil alone.
test:
    cargo test --release --features evil

doc:
    RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --document-private-items

# Advisories need a database that cannot be fetched everywhere: deny.toml lists the known ones.
deny:
    cargo deny --all-features check licenses bans sources

unused:
    cargo machete

typos:
    typos

# Several hosts by network namespaces, ssh, containers and Slurm, for real: what cannot be had here is skipped, loudly.
engines:
    deploy/test/all

# Every OBJ file of two public collections, as trimesh reads it: needs Debian's assimp-testmodels, and trimesh, charset-normalizer and pybullet
# of PyPI.
importers models="/usr/share/assimp/models" pybullet="target/pybullet":
    python3 tests/importers/compare.py target/release/marti "{{ models }}" "{{ pybullet }}"

# The pages of both studies in Chromium, by mouse and keyboard: needs Debian's chromium, and playwright of PyPI.
browser screenshots="target/browser":
    python3 tests/browser/pages.py target/release/marti "{{ screenshots }}"

# Every decoder against a fuzzer for ten minutes each: docs/fuzzing.md.
fuzz:
    fuzz/run

# Instruction counts of the hot paths against those that are recorded: docs/performance.md.
instructions:
    cargo bench --bench instructions

# Records them anew, with the reason: `just instructions-record "what changed"`.
instructions-record reason:
    cargo bench --bench instructions -- --record "{{ reason }}"

# Benchmarks, not tests: they print ratios measured side by side.
bench:
    cargo bench
