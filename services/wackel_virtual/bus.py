"""The virtual bus: a wire whose faults are injected, healed and scheduled."""

from collections.abc import Mapping
from dataclasses import dataclass
from random import Random

from wackel_node.config import BusConfig
from wackel_schemas.virtual import Injection
from wackel_virtual.board import Board
from wackel_virtual.disturbance import Contact
from wackel_virtual.faults import checked, conditions, matches
from wackel_virtual.wire import Wire


@dataclass(eq=False)
class _Fault:
    """An injection and its life on the bus."""

    injection: Injection
    contact: Contact | None
    active: bool = False
    healed: bool = False


class VirtualBus(Wire):
    """Servos on a wire, with faults; see :class:`~wackel_virtual.wire.Wire` for the arguments.

    ``transmit`` and ``deliveries`` are the host's side; ``exchange`` is both in one.
    """

    def __init__(
        self,
        config: BusConfig,
        seed: int | str = 0,
        *,
        latency_ms: int = 0,
        loss: float = 0.0,
        firmware: Mapping[int, int] | None = None,
        tapped: bool = False,
        boards: Mapping[int, Board] | None = None,
    ) -> None:
        super().__init__(
            config,
            seed,
            latency_ms=latency_ms,
            loss=loss,
            firmware=firmware,
            tapped=tapped,
            boards=boards,
        )
        self._seed = seed
        self._injected = 0
        self._faults: list[_Fault] = []

    def inject(self, injection: Injection) -> Injection:
        """Have a fault begin ``start_s`` from now, and end after its duration if it has one.

        Returns:
            The injection with its default value filled in.

        Raises:
            InjectionError: Unknown kind, or a place or value that it cannot have.
        """
        injection = checked(injection, self.ids)
        contact = None
        if injection.kind in ("loose_contact", "loose_contact_bursts"):
            # A generator of its own: how a contact rattles does not depend on the traffic.
            random = Random(f"{self._seed}/contact/{self._injected}")
            bursts = injection.kind == "loose_contact_bursts"
            contact = Contact(random, injection.value or 0.0, bursts=bursts)
        self._injected += 1
        fault = _Fault(injection, contact)
        self._faults.append(fault)
        start_ns = self.now_ns + round(injection.start_s * 1e9)
        self.schedule(start_ns, self._begin, fault)
        if injection.duration_s is not None:
            self.schedule(start_ns + round(injection.duration_s * 1e9), self._end, fault)
        self.advance(self.now_ns)
        return injection

    def heal(self, kind: str = "", servo: int | None = None) -> list[Injection]:
        """End faults now, scheduled ones too; without kind and servo all of them.

        Returns:
            The faults that it concerned. What a fault has left behind stays: a latched hardware
            error until the servo is rebooted, a servo that restarts until it is up.
        """
        healed = [fault for fault in self._faults if matches(fault.injection, kind, servo)]
        for fault in healed:
            self._end(self.now_ns, fault)
        return [fault.injection for fault in healed]

    def active(self) -> list[Injection]:
        """The faults that act now, in the order in which they were injected."""
        return [fault.injection for fault in self._faults if fault.active]

    def _begin(self, at_ns: int, fault: _Fault) -> None:
        if fault.healed:
            return
        fault.active = True
        if fault.contact is not None:
            self.schedule(fault.contact.next_toggle_ns(at_ns), self._toggle, fault)
        self._change(at_ns)

    def _end(self, at_ns: int, fault: _Fault) -> None:
        if fault.healed:
            return
        fault.healed, was_active, fault.active = True, fault.active, False
        self._faults.remove(fault)
        if was_active:
            self._change(at_ns)

    def _toggle(self, at_ns: int, fault: _Fault) -> None:
        contact = fault.contact
        if not fault.active or contact is None:
            return
        contact.open = not contact.open
        self._change(at_ns, contact.spark(at_ns))
        self.schedule(contact.next_toggle_ns(at_ns), self._toggle, fault)

    def _change(self, at_ns: int, spark: bytes | None = None) -> None:
        active = [
            (fault.injection, fault.contact is not None and fault.contact.open)
            for fault in self._faults
            if fault.active
        ]
        self.impose(at_ns, conditions(active, self.ids), spark)
