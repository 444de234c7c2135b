# Debian stable with the same packages as scripts/setup:
#   docker build -t brake_fenicsx . && docker run --rm -v "$PWD:/work" brake_fenicsx run scene.toml
FROM debian:stable-slim
RUN apt-get update && apt-get install -y --no-install-recommends git ca-certificates && rm -rf /var/lib/apt/lists/*
COPY . /opt/brake_fenicsx
RUN /opt/brake_fenicsx/scripts/setup && rm -rf /var/lib/apt/lists/* /root/.cache
ENV PATH=/opt/brake_fenicsx/.venv/bin:$PATH OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
WORKDIR /work
ENTRYPOINT ["brake-fenicsx"]
