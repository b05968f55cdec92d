# Fidelity for people whose system is not Debian: a Debian in which `run` has set up what it needs, by its own list.
#   docker build -t fidelity .
#   docker run --rm -it -v "$PWD":/work fidelity simulate press.toml --out press.vtkhdf
# Files are read from and written to the folder that is mounted at /work. -v fidelity:/root/.cache keeps compiled forms, some twenty
# seconds for each kind of scene. DEBIAN=13 takes the newer one; PIP_EXTRA_INDEX_URL may name an index with a torch without CUDA.
ARG DEBIAN=12
FROM debian:${DEBIAN}-slim
ARG PIP_EXTRA_INDEX_URL
COPY . /opt/fidelity
RUN /opt/fidelity/run --version && rm -rf /var/lib/apt/lists/* /root/.cache/pip
WORKDIR /work
ENTRYPOINT ["/opt/fidelity/run", "fidelity"]
