"""Modbus PDUs and RTU frames; pure. Start at `pdu` and `adu`; the door of the package."""

from gateway.modbus.adu import BROADCAST, FIXED_REPLIES, MAX_ADU_SIZE, Adu, crc16, decode, encode
from gateway.modbus.codes import EXCEPTION_BIT, ExceptionCode, Function, exception_name
from gateway.modbus.device_id import ONE_OBJECT_CODE, DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import Request, encode_exception, exception_code
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters, ReadInputRegisters
from gateway.modbus.server import KnownRequest, decode_request
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import MaskWriteRegister, WriteCoil, WriteCoils, WriteRegister, WriteRegisters
