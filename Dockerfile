# Debian stable with the same packages as scripts/setup, less what no run opens; scripts/test_container
# builds and tries it without a daemon:
#   docker build -t brake_fenicsx . && docker run --rm -v "$PWD:/work" brake_fenicsx run scene.toml
FROM debian:stable-slim
COPY . /opt/brake_fenicsx
ENV PATH=/opt/brake_fenicsx/.venv/bin:$PATH XDG_CACHE_HOME=/opt/brake_fenicsx/.cache \
    OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
# One layer: what is deleted in a later one still counts.
RUN /opt/brake_fenicsx/scripts/setup_image --delete
WORKDIR /work
ENTRYPOINT ["brake-fenicsx"]
