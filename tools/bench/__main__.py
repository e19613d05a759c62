"""`make bench`: every benchmark, as a table or, with --json, as one JSON object."""

import argparse
import json
from typing import Any

from fltea.lab import bench as bench_estimator

from tools.bench import bench_allan, bench_daemon, bench_decode, bench_fit, bench_octaves, identify_tables


def main() -> None:
    """Measure and print; machines are noisy, so medians, their spread and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--daemon", action="store_true", help="measure the running daemon too: some minutes")
    parser.add_argument(
        "--identify", action="store_true", help="only how far `fltea identify` can be believed: half an hour"
    )
    parser.add_argument(
        "--device", action="store_true", help="only what the device's estimates cost, and how near they are"
    )
    parser.add_argument(
        "--chain",
        action="store_true",
        help="only recordings and devices, the chain beside its engine: two minutes",
    )
    parser.add_argument(
        "--long",
        action="store_true",
        help="with --chain: 24 hours, and the largest number of devices: half an hour",
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="only what the live fit costs: accumulators, fits, an hour's replay",
    )
    parser.add_argument(
        "--cluster", action="store_true", help="only `fltea identify --out` with one and two workers of Dask"
    )
    parser.add_argument(
        "--ingest", action="store_true", help="only many sensors through MQTT and NATS: two minutes"
    )
    parser.add_argument("--fleet", action="store_true", help="only `fltea fleet` under load: half a minute")
    parser.add_argument(
        "--devices", type=int, help="sensors of --ingest (default 200) and --fleet (default 500)"
    )
    parser.add_argument("--seconds", type=int, default=15, help="of --ingest")
    parser.add_argument("--seeds", type=int, default=1_000, help="series of the largest of its tables")
    arguments = parser.parse_args()
    if arguments.identify:
        tables = identify_tables.measure(arguments.seeds)
        print(json.dumps(tables, ensure_ascii=False) if arguments.json else identify_tables.text(tables))
        return
    if arguments.device:
        from tools.bench import (
            board_agreement,
            device_cost,
            device_difference,
            spectrum_cost,
        )  # they compile the device's code

        cost, differences = device_cost.measure(), device_difference.measure()
        spectrum, fits = spectrum_cost.measure(), board_agreement.measure()
        if arguments.json:
            print(
                json.dumps(
                    {"cost": cost, "spectrum": spectrum, "differences": differences, "fits": fits},
                    ensure_ascii=False,
                )
            )
        else:
            print(
                device_cost.text(cost),
                spectrum_cost.text(spectrum),
                device_difference.text(differences),
                board_agreement.text(fits),
                sep="\n\n",
            )
        return
    if arguments.cluster:
        from tools.bench import bench_cluster  # Dask is an extra

        rates = bench_cluster.measure()
        print(json.dumps(rates) if arguments.json else bench_cluster.text(rates))
        return
    if arguments.ingest or arguments.fleet:
        _print_many(arguments)
        return
    if arguments.live:
        from tools.bench import bench_live

        costs = bench_live.measure()
        print(json.dumps(costs, ensure_ascii=False) if arguments.json else bench_live.text(costs))
        return
    if arguments.chain:
        from tools.bench import bench_chain  # the recorder's library is an extra

        figures = bench_chain.measure(long=arguments.long)
        print(json.dumps(figures, ensure_ascii=False) if arguments.json else bench_chain.text(figures))
        return
    parts = {
        "decode": bench_decode,
        "allan": bench_allan,
        "octaves": bench_octaves,
        "fit": bench_fit,
        "estimator": bench_estimator,
    }
    found = {name: part.measure() for name, part in parts.items()}
    daemon = bench_daemon.measure() if arguments.daemon else None
    if arguments.json:
        estimator = found.pop("estimator")
        figures = {**found, **estimator, **({"daemon": daemon} if daemon else {})}
        print(json.dumps(figures))
        return
    print("\n\n".join(part.text(found[name]) for name, part in parts.items()))
    if daemon:
        print("\n" + bench_daemon.text(daemon))


def _print_many(arguments: argparse.Namespace) -> None:
    """What is of many sensors; clients of MQTT and NATS are extras."""
    from tools.bench import bench_fleet, bench_ingest

    found: dict[str, Any] = {}
    if arguments.ingest:
        found["ingest"] = bench_ingest.measure(arguments.devices or bench_ingest.DEVICES, arguments.seconds)
    if arguments.fleet:
        found["fleet"] = bench_fleet.measure(arguments.devices or bench_fleet.SENSORS)
    if arguments.json:
        print(json.dumps(found, ensure_ascii=False))
        return
    parts = {"ingest": bench_ingest, "fleet": bench_fleet}
    print("\n\n".join(parts[name].text(figures) for name, figures in found.items()))


if __name__ == "__main__":
    main()
