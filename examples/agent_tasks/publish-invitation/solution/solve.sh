#!/bin/bash
bash bin/publish /app/invitation.txt --owner=ops
