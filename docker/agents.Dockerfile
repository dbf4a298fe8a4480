# The bundled agents: docker build --file docker/agents.Dockerfile --tag avln-agents .
FROM rust:1.95-slim-trixie AS build
WORKDIR /source
COPY . .
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/source/target \
    docker/build.sh /built

FROM debian:trixie-slim
RUN useradd --uid 10001 --home-dir /tmp --shell /usr/sbin/nologin avln
# Certificate authorities, for servers with TLS.
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
COPY --from=build /built/avln /usr/local/bin/avln
COPY --chmod=755 docker/with-token.sh /usr/local/lib/avln/
USER 10001:10001
WORKDIR /tmp
ENTRYPOINT ["/usr/local/lib/avln/with-token.sh"]
CMD ["avln", "agent", "pag-nav"]
