"""Parts of `python -m train.memory`: what is worth remembering where memory is bounded."""
