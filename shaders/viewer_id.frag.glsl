#version 300 es
// Writes the ID into an R32UI target; 0 stays for nothing.
precision highp float;
precision highp int;
flat in highp uint id;
out highp uint fragment;

void main() {
    fragment = id;
}
