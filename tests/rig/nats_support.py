"""Run Debian's nats-server on TCP ports of its own.

A test gets one server, or a cluster of three nodes with the settings files that the project ships.
"""

import os
import shutil
from pathlib import Path

from tests.rig.host_support import ROOT
from tests.rig.toolchain import needed
from tools.faults.server import Server, free_port

PARTITIONS = 4
DEPLOYED = ROOT / "tools/deploy/nats"


def started(folder: Path, settings: Path, port: int, environment: dict[str, str]) -> Server:
    """Start one server process, and return once it listens."""
    command, log = [needed("nats-server"), "-c", settings], folder / f"{settings.stem}-{port}.log"
    return Server(command, [port], log, env={**os.environ, **environment}, cwd=folder)


def mapping(partitions: int = PARTITIONS) -> str:
    """Return the line of the server's settings file that divides the devices' subjects among partitions."""
    mapped = f"fltea.frames.{{{{partition({partitions},1)}}}}.{{{{wildcard(1)}}}}"
    return f'mappings {{ "fltea.*.frames": "{mapped}" }}'


def single(folder: Path, maps: str | None = None, store: str = "8GB", more: str = "") -> Server:
    """Start a server without TLS and accounts.

    `maps`: mapping of subjects to partitions. `store`: size of JetStream's store; "" disables JetStream.
    """
    folder.mkdir()
    port = free_port()
    settings = folder / "nats.conf"
    jetstream = f"jetstream {{ store_dir: {folder}/js, max_file_store: {store} }}" if store else ""
    lines = (
        f"listen: 127.0.0.1:{port}",
        "server_name: one",
        jetstream,
        mapping() if maps is None else maps,
        more,
    )
    settings.write_text("\n".join(lines))
    return started(folder, settings, port, {})


def three_nodes(folder: Path, authority: Path) -> list[Server]:
    """Start the three nodes of tools/deploy/nats on the loopback interface.

    `make_authority` has made their certificates.
    """
    for file in (
        *DEPLOYED.glob("*.conf"),
        *(authority / name for name in ("server.pem", "server.key", "ca.pem")),
    ):
        shutil.copy(file, folder)
    ports = [free_port() for _ in range(9)]
    routes = (folder / "routes.conf").read_text()
    for k in range(3):
        routes = routes.replace(f"node{k + 1}.example:6222", f"localhost:{ports[6 + k]}")
    (folder / "routes.conf").write_text(routes)
    return [
        started(
            folder,
            folder / "node.conf",
            ports[k],
            {
                "FLTEA_NODE": f"node{k + 1}",
                "FLTEA_LISTEN": f"localhost:{ports[k]}",
                "FLTEA_MQTT_LISTEN": f"localhost:{ports[3 + k]}",
                "FLTEA_CLUSTER_LISTEN": f"localhost:{ports[6 + k]}",
                "FLTEA_STORE": str(folder / f"js{k}"),
            },
        )
        for k in range(3)
    ]
