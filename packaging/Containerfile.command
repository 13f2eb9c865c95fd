# The command line, as a user without rights. Files are read and written in /work:
#   docker build -f packaging/Containerfile.command -t latentmotion-command .
#   docker run --rm --network none -v "$PWD:/work" -u "$(id -u):$(id -g)" latentmotion-command \
#     generate "a person walks" -o walk.bvh
FROM python:3.12-slim@sha256:78387bc3881b8273120a12ebe6c1ab22b018ccc2c9adf565ae1ac9b536e184ea

COPY pyproject.toml hatch_build.py README.md LICENSE /source/
COPY src /source/src
RUN pip install --no-cache-dir "/source[usd,video]" && rm -rf /source

USER 10001:10001
ENV LATENTMOTION_CACHE=off PYTHONDONTWRITEBYTECODE=1
WORKDIR /work
ENTRYPOINT ["latentmotion"]
CMD ["--help"]
