"""The inputs that each harness begins with."""

from __future__ import annotations

from fuzz_bag_seeds import bag_seeds, db3_seeds
from fuzz_conversation_seeds import conversation_seeds
from fuzz_layer_seeds import layer_seeds
from fuzz_mcap_seeds import mcap_seeds
from fuzz_message_seeds import message_seeds
from fuzz_seeds import cdr_seeds
from fuzz_text_seeds import carmen_seeds, config_seeds, decision_seeds

SEEDS = {
    "mcap": mcap_seeds,
    "bag": bag_seeds,
    "db3": db3_seeds,
    "carmen": carmen_seeds,
    "cdr": cdr_seeds,
    "config": config_seeds,
    "decision": decision_seeds,
    "layer": layer_seeds,
    "message": message_seeds,
    "network": conversation_seeds,
}
