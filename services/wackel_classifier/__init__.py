"""The bus fault classifier: from raw transactions of a servo bus to named faults.

``core`` takes one transaction after the other; ``symptoms`` says what a single one shows;
``reach``, ``jammers``, ``duplicates``, ``loss``, ``loose_contact``, ``timing``, ``latency_timer``,
``host_lag``, ``adapter_lag``, ``alerts``, ``supply`` and ``frozen`` each look for one family of
faults; ``findings`` turns what they find into reports. ``service`` connects the core with the
topics. Everything but ``service`` is without I/O and clock.
"""
