# The server: docker build --file docker/server.Dockerfile --tag avln-server .
FROM rust:1.95-slim-trixie AS build
WORKDIR /source
COPY . .
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/source/target \
    docker/build.sh /built

FROM debian:trixie-slim
# New volumes on these folders get these owners. Agents share only /token with the server.
RUN useradd --uid 10001 --home-dir /data --shell /usr/sbin/nologin avln \
    && install --directory --owner avln --group avln --mode 700 /data /backups /token
COPY --from=build /built/avln /usr/local/bin/avln
COPY --chmod=755 docker/trial.sh docker/backup.sh docker/isolation.sh /usr/local/lib/avln/
USER 10001:10001
ENV AVLN_DATA=/data
WORKDIR /data
EXPOSE 50051 8080
HEALTHCHECK --interval=10s --timeout=10s --start-period=60s CMD ["avln", "admin", "health"]
CMD ["avln", "serve"]
