"""The memory of one servo: bytes by address, names on top, indirect addresses and EEPROM defaults."""

from robot_retarget.actuators.control_tables import EEPROM_END, INDIRECT, TABLE_END, Model, Register

REBOUND_FROM = 64
"""Indirect addresses reach from here to the end of the table."""


class Registers(dict[str, int]):
    """Values by name, over bytes by address: which addresses exist, without their meaning."""

    def __init__(self, model: Model) -> None:
        super().__init__()
        self.model = model
        self.by_name: dict[str, Register] = model.registers
        self.at: dict[int, tuple[str, Register]] = {
            register.address: (name, register) for name, register in self.by_name.items()
        }
        self._bytes = bytearray(TABLE_END)
        self._exists = bytearray(TABLE_END)
        for register in self.by_name.values():
            self._exists[register.address : register.address + register.size] = b"\x01" * register.size
        for first, data, count in INDIRECT:
            self._exists[first : first + 2 * count] = b"\x01" * (2 * count)
            self._exists[data : data + count] = b"\x01" * count
        self.reset()

    def reset(self, keep: tuple[str, ...] = ()) -> None:
        """Factory defaults everywhere, but for the registers named."""
        kept = {name: self[name] for name in keep}
        for name, register in self.by_name.items():
            self[name] = kept.get(name, register.default)
        self.reset_indirect()

    def reset_ram(self) -> None:
        """Power-up values of everything that is not EEPROM."""
        for name, register in self.by_name.items():
            if register.address >= EEPROM_END:
                self[name] = register.default
        self.reset_indirect()

    def reset_indirect(self) -> None:
        for first, data, count in INDIRECT:
            for k in range(count):
                self._bytes[first + 2 * k : first + 2 * k + 2] = (data + k).to_bytes(2, "little")
                self._bytes[data + k] = 0

    def __setitem__(self, name: str, value: int) -> None:
        register = self.by_name[name]
        span = (1 << 8 * register.size) - 1
        data = (int(value) & span).to_bytes(register.size, "little")
        self._bytes[register.address : register.address + register.size] = data
        super().__setitem__(name, register.decode(data))

    def exists(self, address: int, length: int) -> bool:
        """Whether a stretch starts and ends inside the table and has something in it; gaps read as 0."""
        return length > 0 and address + length <= TABLE_END and any(self._exists[address : address + length])

    def read(self, address: int, length: int) -> bytes:
        """Bytes as a host sees them: indirect data show what their address points to."""
        out = bytearray(self._bytes[address : address + length])
        for first, data, count in INDIRECT:
            for k in range(max(0, data - address), min(length, data + count - address)):
                target = self.target(first, data, address + k)
                if target is not None:
                    out[k] = self._bytes[target]
        return bytes(out)

    def store(self, address: int, data: bytes) -> None:
        """Put bytes where they belong without asking."""
        self._bytes[address : address + len(data)] = data

    def target(self, first: int, data: int, address: int) -> int | None:
        """Where an indirect data byte points, or None where it points to itself."""
        place = first + 2 * (address - data)
        target = int.from_bytes(self._bytes[place : place + 2], "little")
        return None if target == address or not REBOUND_FROM <= target < TABLE_END else target

    def redirected(self, address: int) -> int | None:
        """Where a write to this address lands if it is an indirect data byte that points elsewhere."""
        for first, data, count in INDIRECT:
            if data <= address < data + count:
                return self.target(first, data, address)
        return None

    def covering(self, address: int) -> tuple[str, Register] | None:
        """The register that starts at an address."""
        return self.at.get(address)
