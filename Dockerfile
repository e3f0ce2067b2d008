# marti and its processes in one small image. What it is built from and with are arguments, so that it can be made where
# no registry of images is reached: deploy/test/compose passes images and a build command of its own.
ARG BUILDER=rust:1.95-trixie
ARG BASE=debian:trixie-slim

FROM ${BUILDER} AS build
# Leaves the five binaries in target/release.
ARG BUILD="cargo build --release --locked --config profile.release.debug=false --config profile.release.strip=true"
WORKDIR /marti
COPY . .
RUN ${BUILD}
RUN mkdir /binaries && cp target/release/marti target/release/marti-bus target/release/marti-display \
    target/release/marti-master target/release/marti-node /binaries/

FROM ${BASE}
COPY --from=build /binaries/ /usr/local/bin/
COPY deploy/healthy deploy/compose/keys-by-role /usr/local/bin/
# A volume that is new takes its owner from the folder that it is mounted on.
RUN for role in manager bus master display node; do install -d -o 10001 -g 10001 -m 0700 /keys/$role; done \
    && install -d -o 10001 -g 10001 /keys/authority /out
USER 10001:10001
WORKDIR /out
STOPSIGNAL SIGTERM
CMD ["marti", "--help"]
