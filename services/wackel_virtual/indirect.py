"""Indirect registers: data addresses that stand for whatever other addresses they are pointed at.

Source: ROBOTIS e-manual, "Indirect Address, Indirect Data" of XM430-W210, XL330-M288 and
PH54-200-S500. Each indirect address register has two bytes and points at one byte of the table.
"""

from dataclasses import dataclass

from wackel_protocols.dynamixel2.tables import Series


@dataclass(frozen=True)
class IndirectArea:
    """A row of indirect address registers and the row of data bytes that they stand for.

    Attributes:
        addresses: Address of the first indirect address register.
        data: Address of the first data byte.
        count: How many of each.
    """

    addresses: int
    data: int
    count: int

    @property
    def end(self) -> int:
        """Address after the last byte of both rows."""
        return max(self.addresses + 2 * self.count, self.data + self.count)

    def reset(self, table: bytearray) -> None:
        """Point every data byte at itself."""
        for i in range(self.count):
            place = self.addresses + 2 * i
            table[place : place + 2] = (self.data + i).to_bytes(2, "little")

    def overlaps(self, first: int, end: int) -> bool:
        """Whether data bytes lie in this range of addresses."""
        return first < self.data + self.count and self.data < end

    def holds_data(self, address: int) -> bool:
        """Whether the address is a data byte."""
        return self.data <= address < self.data + self.count

    def holds_addresses(self, address: int, length: int) -> bool:
        """Whether these bytes are whole indirect address registers."""
        offset = address - self.addresses
        return offset >= 0 and offset + length <= 2 * self.count and not (offset | length) & 1

    def read(self, table: bytearray, address: int, data: bytes) -> bytes:
        """``data``, read from ``address`` on, with its indirect bytes replaced."""
        first = max(address, self.data)
        last = min(address + len(data), self.data + self.count)
        if first >= last:
            return data
        resolved = bytearray(data)
        for place in range(first, last):
            target = self._target(table, place)
            resolved[place - address] = table[target] if target < len(table) else 0
        return bytes(resolved)

    def resolve(self, table: bytearray, address: int, data: bytes) -> list[tuple[int, bytes]]:
        """Bytes written from a data address on, as (real address, bytes) of unbroken runs."""
        runs: list[tuple[int, bytearray]] = []
        for offset, value in enumerate(data):
            place = address + offset
            target = self._target(table, place) if self.holds_data(place) else place
            if runs and runs[-1][0] + len(runs[-1][1]) == target:
                runs[-1][1].append(value)
            else:
                runs.append((target, bytearray((value,))))
        return [(target, bytes(run)) for target, run in runs]

    def _target(self, table: bytearray, place: int) -> int:
        pointer = self.addresses + 2 * (place - self.data)
        return table[pointer] | table[pointer + 1] << 8


_X = (IndirectArea(168, 224, 28), IndirectArea(578, 634, 28))
_AREAS = {
    Series.X: _X,
    Series.MX: _X,
    Series.X330: (IndirectArea(168, 208, 20),),
    Series.X335: (IndirectArea(168, 224, 28),),
    Series.P: (IndirectArea(168, 634, 128),),
    Series.XL320: (),
}


def indirect_areas(series: Series) -> tuple[IndirectArea, ...]:
    """The indirect registers of a series."""
    return _AREAS[series]
