"""Define how to reach an MQTT broker (address, password, certificates), and explain each failure.

User and password come from the environment or from a file, and are sent only to the broker: no message
contains them.
"""

import os
import socket
import ssl
from collections.abc import Iterable

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.reasoncodes import ReasonCode

from fltea.records.errors import UsageError
from fltea.records.ports import Report
from fltea.settings.login_file import read_login
from fltea.settings.mqtt import BrokerAddress, MqttConfig

USER, PASSWORD = "FLTEA_MQTT_USER", "FLTEA_MQTT_PASSWORD"
REFUSED_BY_NAME = (0x86, 0x87, 0x8C)
"""MQTT 5 reason codes of a refusal by name: bad user name or password, not authorized, bad authentication
method.
"""

Failure = tuple[str, str]
"""Kind and text of the `error` record by which a failure is reported."""


class Broker:
    """An MQTT broker as the settings describe it.

    Raises:
        UsageError: a file named in the settings cannot be used.
    """

    def __init__(self, settings: MqttConfig) -> None:
        self.address: BrokerAddress = settings.address()
        self.user, self.password = _credentials(settings.password_file)
        self.tls = _tls(settings) if self.address.tls else None

    def report_plain(self, report: Report) -> None:
        """Report an error if the password would cross a network unencrypted."""
        local = self.address.host in ("localhost", "::1") or self.address.host.startswith("127.")
        if self.password is not None and self.tls is None and not local:
            text = "the password crosses the network in clear; use mqtts:// if the broker can."
            report("broker_plain", f"{self.address}: {text}")

    def client(self, client_id: str, userdata: object) -> Client:
        """Return a client, not connected yet, with the broker's user name, password and certificates."""
        client = Client(
            CallbackAPIVersion.VERSION2,
            client_id,
            userdata=userdata,
            protocol=MQTTProtocolVersion.MQTTv5,
            reconnect_on_failure=False,
        )
        if self.user is not None:
            client.username_pw_set(self.user, self.password)
        if self.tls is not None:
            client.tls_set_context(self.tls)
        return client

    def explain_failure(self, error: BaseException | None) -> Failure:
        """Return kind and text of the `error` record for a failure to reach the broker."""
        where = str(self.address)
        if isinstance(error, ssl.SSLCertVerificationError):
            return "broker_certificate", (
                f"{where}: the broker's certificate is not accepted ({error.verify_message}). Is "
                f"mqtt.ca the file of the authority that signed it, does it name {self.address.host}, and is "
                "this machine's date right?"
            )
        if isinstance(error, ssl.SSLError):
            return "broker_certificate", (
                f"{where}: TLS failed ({error.reason or error}). Does this port speak "
                "TLS (usually 8883)? Does the broker want a certificate of ours (mqtt.cert, mqtt.key)?"
            )
        if isinstance(error, ConnectionRefusedError):
            hint = "nobody listens there: is the broker running, and is the port right?"
        elif isinstance(error, socket.gaierror):
            hint = "the name is not known: is it spelt right, is there a network?"
        elif isinstance(error, TimeoutError):
            hint = "no answer: is the machine on, does a firewall stand between?"
        elif isinstance(error, ConnectionResetError):
            hint = self._hung_up()
        else:
            hint = f"{error}."
        return "broker_lost", f"{where}: {hint} fltea tries again."

    def explain_refusal(self, reason: ReasonCode) -> Failure:
        """Return kind and text of the `error` record for the broker's refusal of a connection."""
        where, name = str(self.address), reason.getName()
        if reason.value not in REFUSED_BY_NAME:
            return (
                "broker_refused",
                f"{where}: the broker refuses the connection ({name}). It has to speak MQTT 5.",
            )
        if self.user is None and self.password is None:
            return "broker_refused", (
                f"{where}: the broker wants a user and a password ({name}): set {USER} and {PASSWORD}, or "
                "mqtt.password_file."
            )
        return "broker_refused", (
            f"{where}: the broker refuses user or password ({name}). They come from mqtt.password_file, "
            f"or else from {USER} and {PASSWORD}; does the broker know both?"
        )

    def explain_unreadable(self, topics: Iterable[str]) -> Failure:
        """Return kind and text of the `error` record for topics that this user is not allowed to read."""
        return "broker_refused", (
            f"{self.address}: the broker does not let this user read {', '.join(topics)}: allow it in the "
            "broker's access list."
        )

    def explain_end(self, reason: ReasonCode, answered: bool) -> Failure:
        """Return kind and text of the `error` record for the end of an open connection.

        `answered`: whether the broker had accepted the connection before.
        """
        where, name = str(self.address), reason.getName()
        if answered:
            return "broker_lost", f"{where}: the connection was lost ({name}). fltea tries again."
        return "broker_lost", f"{where}: {self._hung_up()} fltea tries again."

    def _hung_up(self) -> str:
        if self.tls is None:
            return "it hung up before it answered. Does the port want TLS (mqtts://)? Is it an MQTT broker?"
        return (
            "it hung up before it answered. Does the port speak TLS (usually 8883)? Does the broker want a "
            "certificate of ours (mqtt.cert, mqtt.key)?"
        )


def _credentials(file: str | None) -> tuple[str | None, str | None]:
    """Return user and password: from the file that the settings name, if any, else from the environment."""
    if file is None:
        user, password = os.environ.get(USER) or None, os.environ.get(PASSWORD) or None
        if password is not None and user is None:
            raise UsageError(f"{PASSWORD} is set, but {USER} is not: set both.")
        return user, password
    return read_login("mqtt.password_file", file)


def _tls(settings: MqttConfig) -> ssl.SSLContext:
    context = ssl.create_default_context()
    if settings.ca is not None:
        # this context trusts only the certificate authority that the settings name
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        try:
            context.load_verify_locations(settings.ca)
        except OSError as error:
            raise UsageError(f"mqtt.ca {settings.ca}: {_file_problem(error)}") from error
    if settings.insecure:
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if settings.cert is not None:
        try:
            context.load_cert_chain(settings.cert, settings.key, password=_no_passphrase)
        except OSError as error:
            files = settings.cert if settings.key is None else f"{settings.cert}, mqtt.key {settings.key}"
            raise UsageError(f"mqtt.cert {files}: {_file_problem(error)}") from error
    return context


def _no_passphrase() -> str:
    """Return an empty passphrase.

    Without this function, OpenSSL would ask for one at the terminal and wait.
    """
    return ""


def _file_problem(error: OSError) -> str:
    if isinstance(error, ssl.SSLError):
        detail = (error.reason or "no certificate in it").lower().replace("_", " ")
        return f"is not a PEM file of the right kind, has a passphrase, or does not fit ({detail})."
    return f"cannot be read ({error.strerror})."
