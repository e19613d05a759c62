// The common beginning of all small programs of these tests: macros, and the first two vectors.
.syntax unified
.cpu cortex-m3
.thumb
.macro store address, value
  ldr r0, =\address
  ldr r1, =\value
  str r1, [r0]
.endm
.macro load register, address
  ldr r0, =\address
  ldr \register, [r0]
.endm
.macro keep register, slot
  ldr r0, =0x20070000 + 4 * \slot
  str \register, [r0]
.endm
.macro wait address, bits
1: load r1, \address
  ldr r2, =\bits
  tst r1, r2
  beq 1b
.endm
.macro systick reload, control
  store 0xE000E014, \reload
  store 0xE000E018, 0
  store 0xE000E010, \control
.endm
.macro trigger interrupt
  ldr r0, =0xE000EF00
  movs r1, #\interrupt
  str r1, [r0]
.endm
.macro uart_on divider
  store 0x400E0610, 0x100
  store 0x400E0E04, 0x300
  store 0x400E0804, 0x800
  store 0x400E0820, \divider
  store 0x400E0800, 0x40
.endm
.macro wait_forever
2: wfi
  b 2b
.endm
.macro full_speed
  store 0x400E0A00, 0x400
  store 0x400E0C00, 0x400
  store 0x400E0620, 0x00370809
  wait 0x400E0668, 1
  store 0x400E0620, 0x01370809
  wait 0x400E0668, 0x10000
  store 0x400E0628, 0x200D3F01
  wait 0x400E0668, 2
  store 0x400E0630, 0x11
  wait 0x400E0668, 8
  store 0x400E0630, 0x12
  wait 0x400E0668, 8
.endm
// A handler that counts in slot 0.
.macro count_ticks
count:
  ldr r0, =0x20070000
  ldr r1, [r0]
  adds r1, #1
  str r1, [r0]
  bx lr
.endm
.macro handler number, name
  .org 4 * \number
  .word \name + 1
.endm
.section .vectors, "a"
.word 0x20088000, reset + 1
