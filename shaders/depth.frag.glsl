#version 330 core
// Colours nothing: the depth buffer is all that is wanted.
void main() {}
