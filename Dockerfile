# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# docker build -t haptic_accel . && docker run --rm --init --network host haptic_accel
# Then open http://127.0.0.1:8642, as the page is for this machine alone.
FROM ubuntu:24.04
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates git make python3-venv libportaudio2 \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/haptic_accel
COPY . .
RUN make venv
ENV PATH=/opt/haptic_accel/.venv/bin:$PATH
CMD ["haptic-accel", "touch", "--no-open", "--port", "8642"]
