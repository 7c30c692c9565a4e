# gvla2 with its simulated robot, as the README installs it.
#   docker build -t gvla2 . && docker run --rm -v "$PWD/outputs:/gvla2/outputs" gvla2 run task=push_block
FROM python:3.11-slim

# SAPIEN and OpenCV load these even where nothing is shown; python:slim lacks them.
RUN apt-get update && apt-get install -y --no-install-recommends libgl1 libglib2.0-0 libx11-6 && rm -rf /var/lib/apt/lists/*

WORKDIR /gvla2
COPY pyproject.toml setup.py README.md LICENSE ./
COPY gvla2 gvla2
COPY plugins plugins
COPY conf conf
RUN python3 -m venv .venv && .venv/bin/pip install -q -e ".[sim]"
ENV PATH="/gvla2/.venv/bin:$PATH"

# The image is good when the default run can go.
RUN gvla2 doctor
ENTRYPOINT ["gvla2"]
CMD ["run"]
