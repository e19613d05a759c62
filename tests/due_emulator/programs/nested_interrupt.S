// A nested interrupt is taken and returns with all registers restored.
// Software interrupts 30 (priority 0x80) and 31 (0x40): 31 interrupts the handler of 30.
// handlers: 46 low, 47 high
// slots: 0 0x12345678, 1 0x9abcdef0, 2 0x12345678, 3 77, 4 77
  store 0xE000E41C, 0x40800000
  store 0xE000E100, 0xC0000000
  ldr r0, =0xE000EF00
  movs r1, #30
  ldr r2, =0x12345678
  ldr r3, =0x9ABCDEF0
  mov r12, r2
  str r1, [r0]
  keep r2, 0
  keep r3, 1
  mov r2, r12
  keep r2, 2
  wait_forever
low:
  push {r4, lr}
  trigger 31
  movs r3, #1
  load r2, 0x2007000C
  keep r2, 4
  pop {r4, pc}
high:
  movs r2, #77
  keep r2, 3
  movs r3, #2
  mov r12, r3
  bx lr
