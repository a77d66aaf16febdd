"""Motor schemas: the sequences of targets that nodes remember."""

from pacnet.schemas.motor_schemas import MotorSchemas, MotorSchemasConfig
from pacnet.schemas.targets import targets_ahead

__all__ = ["MotorSchemas", "MotorSchemasConfig", "targets_ahead"]
