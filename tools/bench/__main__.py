"""`make bench`: every benchmark, as a table or, with --json, as one JSON object."""

import argparse
import json
from importlib import import_module
from typing import Any, NamedTuple


class Mode(NamedTuple):
    """A group of benchmarks that a flag selects instead of the usual benchmarks.

    `modules`: modules with functions `measure` and `text`; they are imported if the flag is given. `options`:
    options of the command line that are passed to `measure`.
    """

    help: str
    modules: tuple[str, ...]
    options: tuple[str, ...] = ()


USUAL = Mode(
    "",
    (
        "tools.bench.bench_decode",
        "tools.bench.bench_spectrum",
        "tools.bench.bench_tracker",
        "fltea.lab.bench",
    ),
)
MODES = {
    "device": Mode(
        "only what the estimates and fits cost that the board makes",
        ("tools.bench.device_cost", "tools.bench.spectrum_cost"),
    ),
    "chain": Mode(
        "only recordings and live devices, from file or port to output (takes six minutes)",
        ("tools.bench.bench_chain",),
        ("long", "rows", "against", "rounds"),
    ),
    "identify": Mode(
        "only `fltea identify`, compared with the Allan deviation alone",
        ("tools.bench.bench_identify",),
        ("long", "against", "rounds"),
    ),
    "ports": Mode(
        "only devices on ports: latency, costs, and losses on the way and in recordings",
        ("tools.bench.bench_daemon",),
        ("devices", "seconds", "open_files"),
    ),
    "loop": Mode("only which tasks take the processor time of a live device", ("tools.bench.loop_profile",)),
    "reading": Mode("only what reading text costs, compared with pandas", ("tools.bench.bench_reading",)),
    "live": Mode(
        "only the processor time of the live fit: of its running sums, and of its fits",
        ("tools.bench.bench_live",),
    ),
    "memory": Mode(
        "only the filters' compressed memory: number of modes, accuracy, time of a step",
        ("tools.bench.bench_memory",),
    ),
    "cluster": Mode(
        "only `fltea identify --out` with one and two workers of Dask", ("tools.bench.bench_cluster",)
    ),
    "ingest": Mode(
        "only many sensors through MQTT and NATS (takes two minutes)",
        ("tools.bench.bench_ingest",),
        ("devices", "seconds"),
    ),
    "fleet": Mode(
        "only `fltea fleet` under load (takes half a minute)", ("tools.bench.bench_fleet",), ("devices",)
    ),
    "soak": Mode(
        "only a device's stream of several days, which takes minutes",
        ("tools.bench.soak",),
        ("hours", "seed"),
    ),
}


def main() -> None:
    """Run the chosen benchmarks and print the results.

    Times vary from run to run. So the figures are medians with their spread, or ratios of times that were
    measured alternately.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    for name, mode in MODES.items():
        parser.add_argument(f"--{name}", action="store_true", help=mode.help)
    parser.add_argument(
        "--against",
        metavar="COMMIT",
        help="for --chain, --identify: measure the present program and this commit's alternately",
    )
    parser.add_argument(
        "--rows",
        help="for --chain: names of rows, or of groups of rows (hour, day, live, all), separated by commas",
    )
    parser.add_argument("--rounds", type=int, help="for --chain, --identify (default 3; 1 for long rows)")
    parser.add_argument(
        "--long",
        action="store_true",
        help="for --chain, --identify: also measure long rows (24 hours of samples, or ten minutes live)",
    )
    devices = "for --ports (default 300), --ingest (200) and --fleet (500)"
    parser.add_argument("--devices", type=int, help=devices)
    parser.add_argument("--seconds", type=int, help="for --ports (default 60) and --ingest (15)")
    parser.add_argument(
        "--open-files", type=int, help="for --ports: limit of open files (default: the system's)"
    )
    parser.add_argument("--hours", type=float, help="for --soak (default 24)")
    parser.add_argument("--seed", type=int, help="for --soak (default 1)")
    given = vars(parser.parse_args())
    chosen = [mode for name, mode in MODES.items() if given[name]]
    chosen = chosen or [USUAL]
    found: dict[str, Any] = {}
    texts = []
    for mode in chosen:
        options = {name: given[name] for name in mode.options if given[name] is not None}
        for path in mode.modules:
            module = import_module(path)
            name = path.rpartition(".")[2].removeprefix("bench_")
            found[name] = module.measure(**options)
            texts.append(module.text(found[name]))
    print(json.dumps(found, ensure_ascii=False) if given["json"] else "\n\n".join(texts))


if __name__ == "__main__":
    main()
