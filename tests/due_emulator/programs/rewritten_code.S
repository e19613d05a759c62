// If a computing program rewrites code in RAM, the new code runs.
// slots: 1 2
  ldr r2, =0x20071000
  ldr r3, =0x47702001
  str r3, [r2]
  ldr r0, =0x20071001
  blx r0
  keep r0, 0
  ldr r6, =300
1: ldr r3, =0x47702002
  str r3, [r2]
  subs r6, #1
  bne 1b
  movs r1, r0
  ldr r0, =0x20071001
  blx r0
  movs r1, r0
  keep r1, 1
  wait_forever
