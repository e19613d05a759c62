"""Writes firmware/due/sam3x.h: the registers and fields that the bare-metal port uses."""

from tools.generated import rendered
from tools.svd import Field, Peripheral, Register

USED = """
TC0: CCR0=CLKEN,SWTRG CMR0_WAVE_EQ_1=TCCLKS_TIMER_CLOCK1,WAVSEL_UP,WAVE CV0 RC0 SR0 IER0=CPCS
TWI1: CR=START,STOP,MSEN,SVDIS,SWRST MMR=IADRSZ_1_BYTE,MREAD,DADR IADR CWGR=CLDIV,CHDIV
      SR=TXCOMP,RXRDY,TXRDY,OVRE,NACK,ARBLST RHR THR
TRNG: CR=ENABLE,KEY ISR=DATRDY ODATA
PMC: PCER0 CKGR_MOR=MOSCXTEN,MOSCRCEN,MOSCXTST,KEY,MOSCSEL CKGR_PLLAR=DIVA,PLLACOUNT,MULA,ONE
     MCKR=CSS_MAIN_CLK,CSS_PLLA_CLK,PRES_CLK_2 SR=MOSCXTS,LOCKA,MCKRDY,MOSCSELS PCER1
UART: CR=RSTTX,RSTRX,RXDIS,TXEN MR=PAR_NO IER=ENDTX IDR=ENDTX BRGR TPR TCR PTCR=TXTEN
EFC0: FMR=FWS,SCOD FCR=FCMD_STUI,FCMD_SPUI,FKEY_PASSWD FSR=FRDY
EFC1: FMR=FWS
PIOA: PDR ABSR
PIOB: PER PDR OER SODR CODR PDSR IER ISR MDER MDDR ABSR AIMER ESR REHLSR
RSTC: SR=RSTTYP
WDT: CR=WDRSTT,KEY MR=WDV,WDRSTEN,WDD,WDDBGHLT
"""
"""What the firmware uses, in words PERIPHERAL: REGISTER=FIELD,FIELD. Peripherals and registers have their
names in the SVD. Fields, and values of fields, have their names in the header.
"""


def header(peripherals: dict[str, Peripheral]) -> str:
    """Return the text of the header. KeyError is raised for a name that the SVD does not have."""
    used: list[tuple[Peripheral, list[tuple[Register, list[str]]]]] = []
    for word in USED.split():
        if word.endswith(":"):
            used.append((peripherals[word[:-1]], []))
            continue
        name, _, names = word.partition("=")
        peripheral, registers = used[-1]
        register = peripheral.registers[name]
        lines = dict(line for field in register.fields for line in _declared(field))
        registers.append((register, [lines[one] for one in names.split(",") if one]))
    return rendered("sam3x.h", used=used)


def _declared(field: Field) -> list[tuple[str, str]]:
    """Return pairs (name, C++ declaration): one pair for the field, or one for each value of the field."""
    masks = {f"{field.name}_{name}": value for name, value in field.values.items()}
    if field.width == 1 and not masks:
        masks = {field.name: 1}
    if not masks:
        return [(field.name, f"using {field.name} = Field<{field.lsb}, {field.width}>;")]
    return [
        (name, f"static constexpr uint32_t {name} = {value}u << {field.lsb};")
        for name, value in masks.items()
    ]
