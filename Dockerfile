# radiogs-bench in a container. PyPI's PyTorch for Linux computes on CPUs and on NVIDIA GPUs.
#
#   docker build -t radiogs-bench .
#   docker run --rm -v "$PWD/out:/out" radiogs-bench run ablations --preset smoke --out /out/ablations
#   docker run --rm --gpus all -v "$PWD/out:/out" radiogs-bench run ablations --device cuda --out /out/ablations
#
# A smaller image without CUDA: --build-arg TORCH_INDEX=... with the address of PyTorch's index of CPU builds.
FROM python:3.12-slim

ARG TORCH_INDEX=""
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libegl1 libgl1 libosmesa6 \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/radiogs-bench
COPY . .
RUN if [ -n "$TORCH_INDEX" ]; then pip install --no-cache-dir --index-url "$TORCH_INDEX" torch==2.13.0; fi \
    && pip install --no-cache-dir --constraint constraints.txt .
WORKDIR /out
ENTRYPOINT ["radiogs-bench"]
