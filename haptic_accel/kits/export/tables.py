# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parquet and CSV: a file for each signal, with every sample as it was recorded."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
from pyarrow import csv, parquet

from haptic_accel import Bag
from haptic_accel.bags import Signal
from haptic_accel.core import ALL_AXES
from haptic_accel.kits.export.signals import PART, descriptions, signals_of, write_json

METADATA_KEY = b"haptic_accel"
"""Key of the JSON text about a signal in a Parquet file's metadata."""

OPTIONS = {"compression": "zstd", "use_dictionary": False}
"""Options of Parquet files that all readers support."""

_ROWS_ALONE = csv.WriteOptions(include_header=False)


def write_parquet(bag: Bag, folder: Path) -> None:
    """Write a bag's signals as ``NAME.parquet``.

    Columns: stamp, UTC in ns, and x, y, z in the unit that the column's metadata state.
    """
    about = descriptions(bag)
    for exported, signal in signals_of(bag):
        own = {**about, "signals": {exported.name: about["signals"][exported.name]}}
        unit = {"unit": exported.unit}
        fields = [pa.field(axis, pa.float64(), metadata=unit) for axis in ALL_AXES.names]
        fields.insert(0, pa.field("stamp", pa.timestamp("ns", "UTC")))
        schema = pa.schema(fields, metadata={METADATA_KEY: json.dumps(own)})
        file = folder / f"{exported.name}.parquet"
        with parquet.ParquetWriter(file, schema, **OPTIONS) as writer:
            for stamps, columns in _parts(signal):
                moments = pa.array(stamps).cast(schema.field("stamp").type)
                writer.write_table(pa.table([moments, *columns], schema=schema))


def write_csv(bag: Bag, folder: Path) -> None:
    """Write a bag's signals as ``NAME.csv``, and ``signals.json`` that describes them."""
    for exported, signal in signals_of(bag):
        titles = ["stamp [ns]", *(f"{axis} [{exported.unit}]" for axis in ALL_AXES.names)]
        kinds = [pa.int64(), *[pa.float64()] * len(ALL_AXES.names)]
        schema = pa.schema(list(zip(titles, kinds, strict=True)))
        with (folder / f"{exported.name}.csv").open("wb") as file:
            # Titles are written here because pyarrow would quote them.
            file.write(f"{','.join(titles)}\n".encode())
            with csv.CSVWriter(file, schema, write_options=_ROWS_ALONE) as writer:
                for stamps, columns in _parts(signal):
                    writer.write_table(pa.table([stamps, *columns], schema=schema))
    write_json(folder / "signals.json", descriptions(bag))


def _parts(signal: Signal) -> Iterator[tuple[pa.Array, list[pa.Array]]]:
    """Yield stamps and components of successive samples."""
    for begin in range(0, len(signal.stamps), PART):
        part = slice(begin, begin + PART)
        values = signal.values[part]
        yield pa.array(signal.stamps[part]), [pa.array(column) for column in values.T]
