# icgnet serve in a container. Linted with hadolint; not built or run by the tests.
#
#   docker build -t icgnet --build-arg TORCH_INDEX=... .
#   docker run --rm -p 8000:8000 -e ICGNET_TOKEN icgnet
#
# TORCH_INDEX is the address of PyTorch's index of CPU builds; without it pip may fetch the CUDA build, which is large.
# The token is not in the image: without ICGNET_TOKEN the service refuses to listen on 0.0.0.0.
FROM python:3.12.8-slim-bookworm AS build
WORKDIR /build
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY src ./src
ARG TORCH_INDEX=""
RUN python -m venv /opt/icgnet \
    && /opt/icgnet/bin/pip install --no-cache-dir ${TORCH_INDEX:+--index-url "$TORCH_INDEX"} torch==2.13.0 \
    && /opt/icgnet/bin/pip install --no-cache-dir -c constraints.txt ".[serve]"

FROM python:3.12.8-slim-bookworm
RUN useradd --system --uid 10001 --no-create-home icgnet
COPY --from=build /opt/icgnet /opt/icgnet
USER 10001
WORKDIR /tmp
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s \
    CMD ["/opt/icgnet/bin/python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/health', timeout=2)"]
ENTRYPOINT ["/opt/icgnet/bin/icgnet", "serve", "--host", "0.0.0.0"]
